"""The settings of a dataset, and those that are drawn for each exploration.

A recipe is a YAML or JSON file. Its keys are settings of an exploration (``explorer``, ``minutes``,
``turn_deg``, ``odometry``, ``lidar``, or, with dots, those of the robot, its sensors, SLAM and clutter); under
each stands a list of what may be drawn::

    explorer:
      - {value: explore_lite, weight: 3}
      - {value: nearest, weight: 1}
    clutter.furniture:
      - 0.0                                  # the weight is 1
      - {between: [0.2, 1.0], weight: 2}     # uniform
    scanner:                                 # settings that go together, under a name of your choice
      - set: {lidar.range_max: 3.5, slam.max_usable_range: 3.0}
      - set: {lidar.range_max: 8.0, slam.max_usable_range: 7.0}

A mixture has one key, ``recipe``, and under it names of recipes: each exploration draws one of them, and then what that
recipe alone would draw::

    recipe:
      - {value: reference, weight: 9}
      - {value: paper, weight: 3}

What an exploration draws follows from its seed and the name of the key alone: not from other keys, the number
of workers, the order, or from where a run was resumed.
"""

import dataclasses
import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamgym import __version__
from slamgym.cad import PlanSource, plan_groups
from slamgym.cad.plan_filter import PlanFilter
from slamgym.core.config import (
    Count,
    Seed,
    Settings,
    replace_setting,
    setting_names,
    suggest,
    to_dict,
)
from slamgym.core.documents import parse_yaml
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_text
from slamgym.core.limits import YAML_BYTES, shown
from slamgym.core.names import is_own_explorer, uniform_share
from slamgym.dataset.format import EDITION, FORMAT_VERSION
from slamgym.dataset.record import PairConfig
from slamgym.envs import ExploreConfig
from slamgym.envs.config import ERROR_LEVELS
from slamgym.envs.episode import EpisodeConfig
from slamgym.sim import name_of_odometry

PARTS = ("robot", "lidar", "odometry", "slam", "clutter")
"""Parts of the environment whose settings bear on a map."""
EPISODE_SETTINGS = ("explorer", "minutes", "stuck_after", "turn_deg")
MIXTURE = "recipe"
"""Factor that draws one of several recipes; the factors of each are stored as ``<its name>/<factor>``."""


def known_settings() -> list[str]:
    """Every name that a condition may have."""
    env = ExploreConfig()
    inner = [f"{part}.{name}" for part in PARTS for name in setting_names(getattr(env, part))]
    return [*EPISODE_SETTINGS, *ERROR_LEVELS, *inner]


def apply_conditions(base: EpisodeConfig, conditions: Mapping[str, Any]) -> EpisodeConfig:
    """Put conditions into the settings of an exploration.

    Args:
        base: The settings.
        conditions: Settings by name: ``explorer``, ``minutes``, the name of an error level for ``lidar`` or
            ``odometry``, or single settings such as ``slam.particles``. Levels are set before single settings.

    Raises:
        ConfigError: If a name is unknown (the error suggests the nearest), or a value is refused.
    """
    config = base
    for name in sorted(conditions.keys() - {MIXTURE}, key=lambda name: (name.count("."), name)):
        value = conditions[name]
        if name in EPISODE_SETTINGS:
            config = replace_setting(config, name, value)
        elif name in ERROR_LEVELS:
            if not isinstance(value, str):
                raise ConfigError(f"{name} must be the name of an error level, not {shown(value)}")
            level = ERROR_LEVELS[name](value)
            config = dataclasses.replace(config, env=replace_setting(config.env, name, level))
        elif name.partition(".")[0] in PARTS:
            config = dataclasses.replace(config, env=replace_setting(config.env, name, value))
        else:
            raise ConfigError(f"unknown setting {shown(name)}; {suggest(name, known_settings())}")
    return config


def setting_value(config: EpisodeConfig, name: str) -> Any:
    """The value of a setting by the name that conditions use."""
    value: Any = config if name in EPISODE_SETTINGS else config.env
    for part in name.split("."):
        value = getattr(value, part)
    return value


def standard_conditions(config: EpisodeConfig) -> dict[str, Any]:
    """Conditions that every manifest records, even if they don't vary."""
    always = (
        "slam.mode", "slam.particles", "lidar.range_max", "slam.max_usable_range", "clutter.furniture",
        "clutter.people",
    )  # fmt: skip
    named = {"explorer": config.explorer, "odometry": name_of_odometry(config.env.odometry)}
    return named | {name: setting_value(config, name) for name in always}


RECIPES = Path(__file__).parent / "recipes"
"""The recipes that come with the package."""
RANGE_DECIMALS = 3
"""Decimals of a number that is drawn from a range."""


@dataclass(frozen=True)
class Choice:
    """One thing that may be drawn."""

    settings: Mapping[str, Any]
    """Values of settings; ``{"between": [low, high]}`` stands for a number that is drawn from a range."""
    weight: float = 1.0


class Recipe(Settings):
    """Which settings vary, and how. The empty recipe varies nothing."""

    factors: Mapping[str, tuple[Choice, ...]] = field(default_factory=dict)
    """Choices by the name of the factor."""

    def _check(self) -> None:
        owners: dict[tuple[str, str], str] = {}
        for factor, choices in self.factors.items():
            recipe = factor.rpartition("/")[0]
            for name in {name for choice in choices for name in choice.settings}:
                if recipe and name == MIXTURE:
                    raise ConfigError(
                        f"{factor}: a mixture can't hold another; name the recipes of both"
                    )
                owner = owners.setdefault((recipe, name), factor)
                if owner != factor:
                    raise ConfigError(
                        f"{owner!r} and {factor!r} both set {name!r}; let one of them"
                    )
        for explorer in filter(is_own_explorer, map(str, self.values("explorer"))):
            raise ConfigError(
                f"explorer: {shown(explorer)} is code of your own, which no recipe may run; give it by --explorer"
            )

    @property
    def _choices(self) -> list[Choice]:
        return [choice for choices in self.factors.values() for choice in choices]

    @property
    def settings(self) -> frozenset[str]:
        """Names of the settings that the recipe varies."""
        return frozenset(name for choice in self._choices for name in choice.settings) - {MIXTURE}

    def values(self, name: str) -> list[Any]:
        """Values that may be drawn for a setting; of ranges, the ends."""
        found = (
            _ends(choice.settings[name]) for choice in self._choices if name in choice.settings
        )
        return [value for ends in found for value in ends]

    def draw(self, seed: int) -> dict[str, Any]:
        """Draw the settings of the exploration that has this seed."""
        drawn: dict[str, Any] = {}
        # Factors without a recipe's name come first: one of them draws the recipe.
        for name in sorted(self.factors, key=lambda name: "/" in name):
            recipe, _, factor = name.rpartition("/")
            if recipe and recipe != drawn[MIXTURE]:
                continue
            choice = _pick(self.factors[name], uniform_share(f"{seed}/{factor}"))
            for setting, value in choice.settings.items():
                drawn[setting] = _number_between(value, uniform_share(f"{seed}/{factor}/{setting}"))
        return drawn


def episode_conditions(
    recipe: Recipe, base: EpisodeConfig, seed: int
) -> tuple[EpisodeConfig, dict[str, Any]]:
    """The settings of one exploration, and the conditions to record: the usual ones and all that vary."""
    drawn = recipe.draw(seed)
    config = apply_conditions(base, drawn)
    return config, {**standard_conditions(config), **drawn}


def open_recipe(spec: str) -> Recipe:
    """Read a recipe.

    Args:
        spec: A YAML or JSON file, or the name of one that comes with the package, such as ``reference``.

    Raises:
        InputFileError: If the file can't be read or is no recipe.
        ConfigError: If there is no recipe of that name, or it varies an unknown setting or has a senseless
            value.
    """
    path, content = _read_recipe(spec)
    return parse_recipe(content, str(path))


def _read_recipe(spec: str) -> tuple[Path, Mapping[Any, Any]]:
    """The file of a recipe, and its plain form."""
    path = Path(spec)
    if not path.suffix and not path.is_file():
        names = [known.stem for known in RECIPES.glob("*.yaml")]
        if spec not in names:
            raise ConfigError(
                f"no recipe {spec!r}; {suggest(spec, names)} (or give a .yaml or .json file)"
            )
        path = RECIPES / f"{spec}.yaml"
    content = parse_yaml(read_text(path, YAML_BYTES), path)  # JSON is YAML
    if not isinstance(content, Mapping) or not content:
        raise InputFileError(
            path, "is no recipe; give settings, and under each a list of what may be drawn"
        )
    return path, content


def parse_recipe(content: Mapping[Any, Any], where: str) -> Recipe:
    """Build a recipe from its plain form, with those that it mixes, and try every value in turn.

    Raises:
        InputFileError: If a recipe that it mixes can't be read.
        ConfigError: Naming ``where``, the key and the fix.
    """
    factors = _factors(content, where)
    chosen = [choice.settings for choices in factors.values() for choice in choices]
    names = [str(settings[MIXTURE]) for settings in chosen if MIXTURE in settings]
    for name in dict.fromkeys(names):
        path, mixed = _read_recipe(name)
        own = _factors(mixed, str(path))
        factors |= {f"{name}/{factor}": choices for factor, choices in own.items()}
    try:
        return Recipe(factors)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _factors(content: Mapping[Any, Any], where: str) -> dict[str, tuple[Choice, ...]]:
    """The choices of a plain recipe by the names of its factors."""
    factors = {}
    for factor, entries in content.items():
        place = f"{where}: {str(factor)[:80]}"
        if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
            raise ConfigError(f"{place}: give a list of what may be drawn")
        if "/" in str(factor):
            raise ConfigError(
                f"{place}: a name holds no '/', which stands behind the names of mixed recipes"
            )
        factors[str(factor)] = tuple(_choice(str(factor), entry, place) for entry in entries)
    return factors


def _choice(factor: str, entry: Any, place: str) -> Choice:
    """Read one entry of a list and try it out."""
    if not isinstance(entry, Mapping):
        entry = {"value": entry}
    kinds = ("value", "between", "set")
    for key in entry:
        if key not in (*kinds, "weight"):
            raise ConfigError(
                f"{place}: unknown word {shown(key)}; {suggest(str(key), [*kinds, 'weight'])}"
            )
    if len(entry.keys() & kinds) != 1:
        raise ConfigError(
            f"{place}: an entry has either a 'value', a range 'between', or a 'set' of settings"
        )
    weight = entry.get("weight", 1.0)
    if not _is_number(weight) or not weight > 0.0:
        raise ConfigError(f"{place}: the weight must be a number above 0, not {shown(weight)}")
    between = {"between": entry["between"]} if "between" in entry else None
    chosen = entry.get("set", {factor: between or entry.get("value")})
    if not isinstance(chosen, Mapping) or not chosen:
        raise ConfigError(f"{place}: 'set' takes settings and their values")
    settings = {str(name): _value_or_range(value, place) for name, value in chosen.items()}
    try:
        for end in (0, -1):
            apply_conditions(
                EpisodeConfig(), {name: _ends(value)[end] for name, value in settings.items()}
            )
    except ConfigError as error:
        raise ConfigError(f"{place}: {error}") from None
    return Choice(settings, float(weight))


def _value_or_range(value: Any, place: str) -> Any:
    """A value as it is; of a range, that it has two ends."""
    if not isinstance(value, Mapping):
        return value
    ends: Any = value.get("between")
    is_pair = isinstance(ends, Sequence) and not isinstance(ends, str) and len(ends) == 2
    if len(value) != 1 or not is_pair or not all(map(_is_number, ends)) or not ends[0] < ends[1]:
        raise ConfigError(
            f"{place}: 'between' takes two numbers, the smaller first, not {shown(ends)}"
        )
    return {"between": list(ends)}


def _is_number(value: Any) -> bool:
    """True if a value is a number that a float can hold."""
    return (
        isinstance(value, (int, float))
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def _ends(value: Any) -> list[Any]:
    """The value, or both ends of a range."""
    return list(value["between"]) if isinstance(value, Mapping) else [value]


def _number_between(value: Any, share: float) -> Any:
    """The value, or a number within its range; a whole number if both ends are."""
    if not isinstance(value, Mapping):
        return value
    low, high = value["between"]
    if isinstance(low, int) and isinstance(high, int):
        return min(high, low + int(share * (high - low + 1)))
    return round(low + share * (high - low), RANGE_DECIMALS)


def _pick(choices: Sequence[Choice], share: float) -> Choice:
    """The choice in which the share falls when they are laid out by weight."""
    left = share * sum(choice.weight for choice in choices)
    for choice in choices:
        left -= choice.weight
        if left < 0.0:
            return choice
    return choices[-1]


class DatasetConfig(Settings):
    """Everything that decides the content of a dataset, apart from the plans."""

    seed: Seed = 0
    """Seed of the whole dataset; explorations derive theirs from it, the plan id and the repetition."""
    plans_filter: PlanFilter = "none"
    """``useful`` takes homes that are worth exploring: 2-20 rooms, 20-300 m2, at most 30 m long, at most
    1,500 vertices."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """The exploration."""
    pair: PairConfig = field(default_factory=PairConfig)
    """The images."""
    trajectories: Count = 1
    """Explorations of a plan that come one after the other: several SLAM maps of one CAD map."""
    recipe: Recipe = field(default_factory=Recipe)
    """Settings that vary from one exploration to the next."""

    def _check(self) -> None:
        default = EpisodeConfig()
        for name in sorted(self.recipe.settings):
            if setting_value(self.episode, name) != setting_value(default, name):
                raise ConfigError(
                    f"{name} is set, but the recipe varies it; leave one of the two out"
                )


def dataset_settings(config: DatasetConfig, plans: PlanSource) -> dict[str, Any]:
    """The content of ``config.json``: two datasets with the same one have the same pairs."""
    groups = []
    for group in plan_groups(plans):
        ids = "".join(f"{plan_id}\n" for plan_id in group.ids)
        digest = hashlib.sha256(ids.encode()).hexdigest()
        groups.append({"count": len(group.ids), "sha256": digest, "weight": group.weight})
    return {
        "format_version": FORMAT_VERSION,
        "edition": EDITION,
        "version": __version__,
        "plans": groups,
        **to_dict(config),
    }

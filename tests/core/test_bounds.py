"""Every number among the settings has bounds, and the greatest allowed ones can be computed with."""

import contextlib
import importlib
import math
import re
import typing
from pathlib import Path

import pytest

from slamgym.cad import generate_plan
from slamgym.core.config import (
    LARGEST,
    Arguments,
    Settings,
    Within,
    _fields,
    replace_setting,
    setting_names,
)
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.envs import ExploreConfig, ExploreEnv

PACKAGES = (
    "agents", "cad", "commands", "core", "dataset", "drawing", "envs", "gan", "interop", "metrics", "parametric",
    "planning", "ros2", "sim", "slam", "viz",
)  # fmt: skip
ENDLESS = {("CostmapConfig", "coastal_distance"), ("ExplorationLoopConfig", "split_extent")}
"""Where infinity has a meaning."""
HUGE = (1e300, -1e300, 2**63, -(2**63), 10**400, math.nan, -math.inf, math.inf)


def settings_classes():
    """All classes of settings in the package."""
    for package in PACKAGES:
        (folder,) = importlib.import_module(f"slamgym.{package}").__path__
        for path in Path(folder).rglob("*.py"):
            if re.search(r"\((Settings|Arguments)\b", path.read_text(encoding="utf-8")):
                inside = path.relative_to(folder).with_suffix("").parts
                importlib.import_module(".".join(("slamgym", package, *inside)))
    found, left = set(), [Settings]
    while left:
        below = left.pop().__subclasses__()
        found |= set(below)
        left += below
    return sorted(found - {Arguments}, key=lambda cls: (cls.__module__, cls.__name__))


def has_infinity(cls, name):
    return any((base.__name__, name) in ENDLESS for base in cls.__mro__)


def test_no_setting_takes_any_number():
    classes = [cls for cls in settings_classes() if cls.__module__.startswith("slamgym.")]
    assert len(classes) > 40
    accepted = []
    for cls in classes:
        for name, field in _fields(cls).items():
            if field.hint is typing.Any:
                continue
            for number in HUGE:
                values = [number, *((number,) * count for count in range(1, 5))]
                if any(field.test(value) is None for value in values):
                    if number == math.inf and has_infinity(cls, name):
                        continue
                    accepted.append((cls.__name__, name, number))
    assert accepted == []


def test_no_seed_of_any_settings_is_below_zero():
    seeds = {cls: _fields(cls)["seed"] for cls in settings_classes() if "seed" in _fields(cls)}
    assert {"TranslatorTrainingConfig", "DatasetConfig"} <= {cls.__name__ for cls in seeds}
    assert [cls.__name__ for cls, field in seeds.items() if field.test(-1) is None] == []


def test_what_has_no_upper_bound_of_its_own_says_the_largest():
    class Free(Settings, section="free"):
        speed: float = 0.0
        count: typing.Annotated[int, Within(ge=1)] = 1

    assert Free(speed=-LARGEST).speed == -LARGEST
    with pytest.raises(ConfigError, match=r"free\.speed must be at most 1e\+09 in size, not 2"):
        Free(speed=2e9)
    with pytest.raises(ConfigError, match=r"free\.count must be at most 1e\+09 in size, not 10"):
        Free(count=10**10)
    with pytest.raises(ConfigError, match=r"free\.count must be at least 1, not 0"):
        Free(count=0)


def greatest(hint, rule=None):
    """The greatest number that a type allows; None if it is none."""
    options = typing.get_args(hint)
    if typing.get_origin(hint) is typing.Annotated:
        own = [each for each in options[1:] if isinstance(each, Within)]
        return greatest(options[0], own[0] if own else rule)
    if hint not in (int, float):
        return next(filter(None, (greatest(each, rule) for each in options)), None)
    rule = rule or Within()
    most = min(rule.le, rule.lt, LARGEST)
    return hint(most) if rule.lt > most else math.nextafter(most, 0.0)


def hint_of(config, name):
    *parts, last = name.split(".")
    for part in parts:
        config = getattr(config, part)
    return typing.get_type_hints(type(config), include_extras=True)[last]


PLAN = generate_plan(3)


@pytest.mark.parametrize("name", setting_names(ExploreConfig()))
def test_the_greatest_numbers_can_be_computed_with(name):
    """Either an environment runs with it, or one sentence says why it doesn't."""
    hint = hint_of(ExploreConfig(), name)
    number = greatest(hint)
    if number is None:
        pytest.skip("it is no number")
    value = (number,) * 3 if name.endswith("mount") else number
    with contextlib.suppress(SlamgymError):
        config = replace_setting(ExploreConfig(), name, value)
        with ExploreEnv(PLAN, config) as env:
            env.reset(seed=1)
            env.step(env.action_space.sample())
            assert math.isfinite(env.simulation.time)

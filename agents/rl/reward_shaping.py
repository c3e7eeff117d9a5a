"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains every preset with every seed, explores held-out plans with each policy and
the particle filter, and hands the :class:`ShapingRun` records to :mod:`slamgym.agents.rl.shaping_report`.
Training goes on from its checkpoint after an interruption, and the test from its last exploration:
``shaping.json`` in the folder of a run is written again, whole, after each.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamgym.agents.rl.reward_presets import REWARD_PRESETS, reward_preset
from slamgym.agents.rl.train_config import POLICY, Curriculum, TrainConfig
from slamgym.agents.rl.validation import PolicyOutcome, explore_plan
from slamgym.core.config import Count, Settings, config_hash, from_dict, to_dict
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import own_folder, read_text, write_text
from slamgym.core.own_code import own_function
from slamgym.core.progress import say, show_progress
from slamgym.core.seeding import exploration_seed
from slamgym.envs import RewardFunction

if TYPE_CHECKING:
    from slamgym.cad import FloorPlan


Term = tuple[str, float, RewardFunction]
"""Name, weight and function of a term of the user's own."""

OWN = "own"
"""RewardPreset that a term of the user's own makes ..."""
BASE = "time"
"""... on top of this one, as those of the package are."""
FEW_SEEDS = 3
"""Intervals over fewer trainings say little."""

RESULTS = "shaping.json"


class ShapingConfig(Settings):
    """An experiment."""

    presets: tuple[str, ...] = tuple(REWARD_PRESETS)
    """Names of presets; ``slamgym agents shape --list`` explains them. If one of them needs the particle filter,
    or may, as ``own``, all are trained with it, so that they differ in the reward alone."""
    seeds: Count = 3
    """Runs of each preset."""
    test_plans: Count = 20
    """Held-out plans that every policy explores at the end."""
    particles: Count = 30
    """Particles of the filter in that test."""
    train: TrainConfig = field(
        default_factory=lambda: TrainConfig(
            steps=15_000, plan_count=300, evaluate_every=0, curriculum=Curriculum(areas=(), shares=())
        )
    )
    """Each run, but for its reward and seed. Without a curriculum, so that the curves don't show its stages."""

    def _check(self) -> None:
        for name in self.presets:
            if name != OWN:
                reward_preset(name)


@dataclass(frozen=True)
class ShapingRun:
    """One trained policy and how it did."""

    preset: str
    seed: int
    curve: list[tuple[float, float]]  # (steps, mean time of the training's episodes so far [s])
    outcomes: list[PolicyOutcome]  # one of each test plan


@dataclass(frozen=True)
class _Identity:
    """What a run's results depend on, and by which they are known again."""

    train: TrainConfig
    particles: int
    term: tuple[str, float] | None


def run_shaping(
    config: ShapingConfig, out: Path, learn: Callable[..., Any], term: Term | None = None
) -> list[ShapingRun]:
    """Train and test every preset with every seed.

    Args:
        config: The experiment.
        out: Its folder: one folder for each run.
        learn: :func:`slamgym.agents.rl.train.train`, which needs torch.
        term: A term of the user's own, for the preset ``own``.

    Raises:
        ConfigError: If the folder holds runs with other settings.
    """
    from slamgym.agents.rl.training_envs import draw_plans

    plans = draw_plans(config.train.plans, "test", config.test_plans)
    return [
        _run_one(config, name, seed, out / name / f"seed_{seed}", plans, learn, term)
        for name in config.presets
        for seed in range(config.seeds)
    ]


def _run_one(
    config: ShapingConfig,
    name: str,
    seed: int,
    folder: Path,
    plans: Sequence[FloorPlan],
    learn: Callable[..., Any],
    term: Term | None,
) -> ShapingRun:
    """Train and test one preset with one seed, or what is left of that."""
    settings = settings_of(config, name, seed)
    term = term if name == OWN else None
    identity = config_hash(
        _Identity(dataclasses.replace(settings, workers=1), config.particles, term[:2] if term else None)
    )
    outcomes = _read(folder, identity)
    left = [plan for plan in plans if plan.id not in outcomes]
    if left:
        say(f"{name}, seed {seed}")
        own_folder(own_folder(folder.parent) / folder.name)
        _write(folder, identity, outcomes)  # before the training: a term's weight stands nowhere else
        learn(settings, folder, reward_terms=_terms(name, term))
        with show_progress("test explorations", len(plans) - len(left), len(plans)) as advance:
            for plan, outcome in test_policy(settings, folder / POLICY, left, config.particles):
                outcomes[plan.id] = outcome
                _write(folder, identity, outcomes)
                advance()
    return ShapingRun(name, seed, read_curve(folder), [outcomes[plan.id] for plan in plans])


def settings_of(config: ShapingConfig, name: str, seed: int) -> TrainConfig:
    """The training run of a preset and a seed."""
    # A term of one's own may charge errors that known poses don't have.
    needs_filter = any(other == OWN or reward_preset(other).needs_filter for other in config.presets)
    localization = "rbpf" if needs_filter else config.train.localization
    base = dataclasses.replace(config.train, seed=seed, localization=localization)
    chosen = reward_preset(BASE if name == OWN else name)
    network = dataclasses.replace(
        base.network, exposure_prior=base.network.exposure_prior + chosen.exposure_prior
    )
    return dataclasses.replace(base, reward=chosen.reward, network=network)


def _terms(name: str, term: Term | None) -> dict[str, tuple[float, RewardFunction]] | None:
    """Terms of the reward that no weight of its configuration stands for."""
    if name == OWN:
        return {term[0]: term[1:]} if term else None
    return dict(reward_preset(name).terms) or None


def test_policy(
    settings: TrainConfig, path: Path, plans: Sequence[FloorPlan], particles: int
) -> Iterator[tuple[FloorPlan, PolicyOutcome]]:
    """Explore held-out plans with a trained policy, the particle filter on and maps of full resolution.

    Start and noise of an exploration follow from its plan's id, whatever the other plans.
    """
    from slamgym.agents.pretrained_policy import read_policy
    from slamgym.agents.rl.training_envs import make_env
    from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

    scorer = read_policy(path).scorer()
    env = make_env(
        dataclasses.replace(settings, resolution=0.05), plans,
        localization="rbpf", slam={"particles": particles}, coverage_goal=None,
    )  # fmt: skip
    assert isinstance(env, ExploreFrontiersEnv)
    for plan in plans:
        yield plan, explore_plan(env, scorer.choose, plan, exploration_seed(0, plan.id, 0))


def read_curve(folder: Path) -> list[tuple[float, float]]:
    """Steps, and mean duration of the latest hundred episodes of training then [s]."""
    rows = []
    for path in sorted(folder.glob("log/*/progress.csv")):
        lines = read_text(path).splitlines()
        if not lines:
            continue
        names = lines[0].split(",")
        for line in lines[1:]:
            row = dict(zip(names, line.split(","), strict=False))
            if row.get("rollout/episode_seconds") and row.get("time/total_timesteps"):
                with contextlib.suppress(ValueError):  # a killed run may leave half a line
                    rows.append((float(row["time/total_timesteps"]), float(row["rollout/episode_seconds"])))
    return rows


def own_term(spec: str, weight: float) -> Term:
    """A function of a :class:`~slamgym.envs.rewards.StepRecord` named as ``module:function``.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    return spec.partition(":")[2], weight, own_function(spec, "--term")


def _write(folder: Path, identity: str, outcomes: Mapping[str, PolicyOutcome]) -> None:
    document = {"settings": identity, "outcomes": {plan: to_dict(o) for plan, o in outcomes.items()}}
    write_text(folder / RESULTS, json.dumps(document, indent=1) + "\n")


def _read(folder: Path, identity: str) -> dict[str, PolicyOutcome]:
    """What was tested of a run, by plan.

    Raises:
        ConfigError: If it was another run.
        InputFileError: If the file is damaged.
    """
    path = folder / RESULTS
    if not path.exists():
        return {}
    document = read_json(path, "delete it to test that run again")
    try:
        found = str(document["settings"])
        outcomes = {plan: from_dict(PolicyOutcome, values) for plan, values in document["outcomes"].items()}
    except (KeyError, TypeError, AttributeError, ConfigError) as error:
        raise InputFileError(path, f"is damaged ({error}); delete it to test that run again") from None
    if found != identity:
        raise ConfigError(
            f"{folder} holds a run with other settings (training, particles, term or presets that need the "
            "filter); choose another folder"
        )
    return outcomes

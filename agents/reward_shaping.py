"""Reward-shaping experiments: the same learner with different rewards, over several seeds.

Main path: :func:`run_shaping` trains every preset with every seed (a run that is done is not done again),
explores held-out plans with each policy and the particle filter, and hands the :class:`ShapingRun` records to
:mod:`agents.shaping_report`.
"""

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from agents.learning_envs import make_env
from agents.learning_plans import Curriculum, draw_plans
from agents.pretrained_policy import read_policy
from agents.reward_presets import PRESETS, preset
from agents.train_config import TrainConfig
from agents.validation import Outcome, explore
from slamgym.cad import FloorPlan
from slamgym.command_table import load_target
from slamgym.config import suggest, to_dict
from slamgym.dataset.progress import say
from slamgym.envs import RewardFunction
from slamgym.envs.frontier_actions import ExploreFrontiersEnv
from slamgym.errors import ConfigError, SlamgymError
from slamgym.interop.atomic import write_text

Term = tuple[str, float, RewardFunction]
"""Name, weight and function of a term of the user's own."""

OWN = "own"
"""Preset that a term of the user's own makes."""


@dataclass(frozen=True)
class ShapingConfig:
    """An experiment."""

    presets: tuple[str, ...] = tuple(PRESETS)
    """Names of presets; ``slamgym agents shape --list`` explains them."""
    seeds: int = 3
    """Runs of each preset."""
    test_plans: int = 20
    """Held-out plans that every policy explores at the end."""
    particles: int = 30
    """Particles of the filter in that test."""
    train: TrainConfig = field(
        default_factory=lambda: TrainConfig(
            steps=15_000, plan_count=300, evaluate_every=0, curriculum=Curriculum(areas=(), shares=())
        )
    )
    """Each run, but for its reward and seed. Without a curriculum, lest the curves show its stages."""

    def __post_init__(self) -> None:
        for name in self.presets:
            if name != OWN:
                preset(name)
        if self.seeds < 1 or self.test_plans < 1:
            raise ConfigError("seeds and test_plans must be at least 1")
        if self.train.env != "explore_frontiers":
            raise ConfigError("reward presets are compared on --train.env explore_frontiers")


@dataclass(frozen=True)
class ShapingRun:
    """One trained policy and how it did."""

    preset: str
    seed: int
    curve: list[tuple[float, float]]  # (steps, mean time of the training's episodes so far [s])
    outcomes: list[Outcome]  # one of each test plan


def run_shaping(
    config: ShapingConfig, out: Path, learn: Callable[..., Any], term: Term | None = None
) -> list[ShapingRun]:
    """Train and test every preset with every seed.

    Args:
        config: The experiment.
        out: Its folder: one folder for each run.
        learn: :func:`agents.train.train`, which needs torch.
        term: A term of the user's own, for the preset ``own``.
    """
    plans = draw_plans(config.train.plans, "test", config.test_plans)
    runs = []
    for name in config.presets:
        for seed in range(config.seeds):
            folder = out / name / f"seed_{seed}"
            run = _read(folder, name, seed, len(plans))
            if run is None:
                say(f"{name}, seed {seed}")
                settings = settings_of(config, name, seed)
                learn(settings, folder, reward_terms={term[0]: term[1:]} if term and name == OWN else None)
                outcomes = test_policy(settings, folder / "policy.safetensors", plans, config.particles)
                run = ShapingRun(name, seed, read_curve(folder), outcomes)
                _write(folder, run)
            runs.append(run)
    return runs


def settings_of(config: ShapingConfig, name: str, seed: int) -> TrainConfig:
    """The training run of a preset and a seed."""
    base = dataclasses.replace(config.train, seed=seed)
    if name == OWN:
        return base
    chosen = preset(name)
    localization = "rbpf" if chosen.needs_filter else base.localization
    return dataclasses.replace(base, reward=chosen.reward, localization=localization)


def test_policy(
    settings: TrainConfig, path: Path, plans: Sequence[FloorPlan], particles: int
) -> list[Outcome]:
    """Explore held-out plans with a trained policy, the particle filter on and maps of full resolution."""
    scorer = read_policy(path).scorer()
    env = make_env(
        dataclasses.replace(settings, resolution=0.05), plans,
        localization="rbpf", slam={"particles": particles}, coverage_goal=None,
    )  # fmt: skip
    assert isinstance(env, ExploreFrontiersEnv)
    return [explore(env, scorer.choose, plan, seed) for seed, plan in enumerate(plans)]


def read_curve(folder: Path) -> list[tuple[float, float]]:
    """Steps, and mean duration of the latest hundred episodes of training then [s]."""
    rows = []
    for path in sorted(folder.glob("log/*/progress.csv")):
        lines = path.read_text().splitlines()
        if not lines:
            continue
        names = lines[0].split(",")
        for line in lines[1:]:
            row = dict(zip(names, line.split(","), strict=False))
            if row.get("rollout/episode_seconds") and row.get("time/total_timesteps"):
                rows.append((float(row["time/total_timesteps"]), float(row["rollout/episode_seconds"])))
    return rows


def own_term(spec: str, weight: float) -> Term:
    """A function of a :class:`~slamgym.envs.rewards.StepRecord` named as ``module:function``.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    module, _, name = spec.partition(":")
    try:
        function = load_target(spec) if name else None
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"--term {spec!r} can't be imported ({error})") from None
    if not callable(function):
        raise ConfigError(f"--term {spec!r} must be module:function; {suggest(module, [module])}")
    return name, weight, function


def means(runs: Sequence[ShapingRun], name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """A field of the outcomes, one value for each run: the mean over plans."""
    return np.array([np.mean([getattr(outcome, name) for outcome in run.outcomes]) for run in runs])


def _write(folder: Path, run: ShapingRun) -> None:
    write_text(folder / "shaping.json", json.dumps(to_dict(run), indent=1) + "\n")


def _read(folder: Path, name: str, seed: int, plans: int) -> ShapingRun | None:
    """A run that is done."""
    try:
        values = json.loads((folder / "shaping.json").read_text())
    except OSError:
        return None
    except ValueError:
        raise SlamgymError(
            f"{folder / 'shaping.json'}: is damaged; delete it to test that run again"
        ) from None
    outcomes = [Outcome(**outcome) for outcome in values["outcomes"]]
    curve = [(float(steps), float(value)) for steps, value in values["curve"]]
    return ShapingRun(name, seed, curve, outcomes) if len(outcomes) == plans else None

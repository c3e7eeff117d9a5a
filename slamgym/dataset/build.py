"""The main path of ``slamgym generate``: floor plans in, a folder of map pairs out."""

import dataclasses
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2

from slamgym import __version__
from slamgym.cad import FloorPlan, PlanSource, check_plan, plan_groups
from slamgym.config import config_hash, to_dict
from slamgym.dataset.engine import run_tasks
from slamgym.dataset.episode import EpisodeConfig, MakeExplorer, check_explorer, run_episode
from slamgym.dataset.episode_files import write_episode
from slamgym.dataset.folder import SIDES, DatasetFolder, open_dataset
from slamgym.dataset.format import FORMAT_VERSION
from slamgym.dataset.pair import PairConfig, make_pair
from slamgym.dataset.plan_filter import PlanFilter, passes
from slamgym.dataset.progress import show_progress
from slamgym.dataset.recipe import Recipe, check_recipe, episode_conditions
from slamgym.dataset.record import make_record
from slamgym.dataset.schedule import Slot, ids_digest, schedule_groups
from slamgym.dataset.storage import storage_errors, sync_tree, write_durably
from slamgym.errors import ConfigError, PlanError, SlamgymError
from slamgym.warmup import kernels_are_compiled, warm_up


@dataclass(frozen=True)
class DatasetConfig:
    """Everything that decides the content of a dataset, apart from the plans."""

    seed: int = 0
    """Seed of the whole dataset; explorations derive theirs from it, the plan id and the repetition."""
    plans_filter: PlanFilter = "none"
    """``useful`` takes homes that are worth exploring: 2-20 rooms, 20-300 m2, at most 30 m long, at most
    1,500 vertices."""
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    """The exploration."""
    pair: PairConfig = field(default_factory=PairConfig)
    """The images."""
    trajectories: int = 1
    """Explorations of a plan that come one after the other: several SLAM maps of one CAD map."""
    recipe: Recipe = field(default_factory=Recipe)
    """What varies from one exploration to the next."""

    def __post_init__(self) -> None:
        if self.trajectories < 1:
            raise ConfigError(f"trajectories must be at least 1, not {self.trajectories}")
        check_recipe(self.recipe, self.episode)


@dataclass(frozen=True)
class BuildReport:
    """What a run of :func:`build_dataset` did."""

    pairs: int
    """Pairs in the folder now."""
    fresh: int
    """Pairs that this run added."""
    rejected: dict[str, int]
    """How many plans gave no pair, by the kind of error; see ``rejected.jsonl``."""
    seconds: float
    """Wall time of this run [s]."""


@dataclass(frozen=True)
class _Exploration:
    """A task for a worker."""

    slot: Slot
    plan: FloorPlan
    root: Path
    staged: Path
    config: DatasetConfig
    make_explorer: MakeExplorer


@dataclass(frozen=True)
class _Outcome:
    """What a worker reports: the pair lies in ``staged``, or ``error`` says why there is none."""

    slot: Slot
    staged: Path
    timing: dict[str, Any] = field(default_factory=dict)
    error: str = ""
    reason: str = ""


def build_dataset(
    root: Path | str,
    plans: PlanSource,
    config: DatasetConfig,
    make_explorer: MakeExplorer,
    *,
    pairs: int,
    workers: int = 1,
) -> BuildReport:
    """Explore floor plans until the folder holds the wanted number of pairs.

    Pairs that are there already are kept; a run that was interrupted goes on where it stopped. The content
    depends on the plans and the settings alone, not on the number of workers or on interruptions.

    Args:
        root: The dataset's folder; made if it is missing.
        plans: Where the floor plans come from.
        config: The settings.
        make_explorer: Makes the explorer of an exploration; a function that can be pickled by reference.
        pairs: How many pairs the folder shall hold.
        workers: Number of processes.

    Raises:
        ConfigError: If the folder holds pairs made with other settings.
        StorageError: If the folder can't be written, or another run is writing to it.
        SlamgymError: If no plan at all can be explored.
    """
    began = time.monotonic()
    for explorer in config.recipe.values("explorer") or [config.episode.explorer]:
        check_explorer(plans, dataclasses.replace(config.episode, explorer=explorer), make_explorer)
    if not kernels_are_compiled():
        warm_up()  # here, once, rather than in every worker
    with open_dataset(Path(root), dataset_settings(config, plans)) as folder:
        before = len(folder.committed)
        queue = _Queue(folder, plans, config, make_explorer, pairs)
        with show_progress("pairs", min(before, pairs), pairs) as advance:
            while queue.wants_more():
                for outcome in run_tasks(_explore, queue.draw(), workers):
                    if outcome.error:
                        queue.reject(outcome.slot, outcome.error, outcome.reason)
                    else:
                        folder.commit(outcome.staged, outcome.timing)
                        advance()
        committed = len(folder.committed)
        kinds = {entry["plan_id"]: entry["error"] for entry in folder.rejected.values()}
    return BuildReport(committed, committed - before, dict(Counter(kinds.values())), time.monotonic() - began)


def dataset_settings(config: DatasetConfig, plans: PlanSource) -> dict[str, Any]:
    """The content of ``config.json``: two datasets with the same one have the same pairs."""
    return {
        "format_version": FORMAT_VERSION,
        "version": __version__,
        "plans": [
            {"count": len(group.ids), "sha256": ids_digest(group.ids), "weight": group.weight}
            for group in plan_groups(plans)
        ],
        **to_dict(config),
    }


class _Queue:
    """Draws explorations from the schedule until enough slots hold a pair or are being explored."""

    def __init__(
        self,
        folder: DatasetFolder,
        plans: PlanSource,
        config: DatasetConfig,
        make_explorer: MakeExplorer,
        pairs: int,
    ) -> None:
        self._folder, self._plans, self._config, self._make_explorer = folder, plans, config, make_explorer
        self._slots = schedule_groups(plan_groups(plans), config.seed, config.trajectories)
        self._missing = pairs
        self._barren = 0

    def wants_more(self) -> bool:
        """Whether slots are still missing."""
        return self._missing > 0

    def draw(self) -> Iterator[_Exploration]:
        """Yield the explorations to run; a rejection on the way makes it go on with the next slot."""
        while self._missing > 0:
            slot = next(self._slots)
            if slot.name in self._folder.committed:
                self._missing -= 1
                continue
            plan = self._load(slot)
            if plan is None:
                self._note_barren()
                continue
            self._missing -= 1
            self._barren = 0
            root, staged = self._folder.layout.root, self._folder.stage(slot.name)
            yield _Exploration(slot, plan, root, staged, self._config, self._make_explorer)

    def reject(self, slot: Slot, error: str, reason: str) -> None:
        """Note that a slot gives no pair; another one takes its place."""
        self._folder.reject(slot, error, reason)
        self._missing += 1
        self._note_barren()

    def _load(self, slot: Slot) -> FloorPlan | None:
        if slot.index in self._folder.rejected:
            return None
        try:
            plan = self._plans.load(slot.plan_id)
            check_plan(plan, self._config.episode.env.robot.radius)
        except PlanError as error:
            self._folder.reject(slot, "PlanError", error.reason)
            return None
        return plan if passes(plan, self._config.plans_filter) else None

    def _note_barren(self) -> None:
        self._barren += 1
        if self._barren >= max(len(self._plans), 1) * self._config.trajectories:
            raise SlamgymError(
                f"none of the {len(self._plans)} plans gave a pair; {self._folder.layout.rejected} says why, "
                "unless the filter leaves none"
            )


def _explore(exploration: _Exploration) -> _Outcome:
    """Run one exploration and write its pair into the staging folder (in a worker)."""
    slot, staged = exploration.slot, exploration.staged
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        _write_pair(exploration)
    except PlanError as error:
        return _Outcome(slot, staged, error="PlanError", reason=error.reason)
    except (SlamgymError, OSError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001 - one odd plan must not end a night's run; the record names the place
        return _Outcome(slot, staged, error=type(error).__name__, reason=_place_of(error))
    timing = {"cpu_seconds": time.process_time() - cpu, "wall_seconds": time.perf_counter() - wall}
    return _Outcome(slot, staged, timing)


def _write_pair(exploration: _Exploration) -> None:
    slot, staged, config = exploration.slot, exploration.staged, exploration.config
    settings, conditions = episode_conditions(config.recipe, config.episode, slot.seed)
    episode = run_episode(exploration.plan, slot.seed, settings, exploration.make_explorer)
    pair = make_pair(episode.plan, episode.start, episode.slam_map, config.pair)
    images = {side: _png(image) for side, image in zip(SIDES, (pair.cad, pair.slam), strict=True)}
    with storage_errors(exploration.root):
        (staged / "episode").mkdir(parents=True)
        sums = write_episode(staged / "episode", episode)
        record = make_record(
            slot, episode, pair, {**images, "episode": sums}, conditions, config_hash(config)
        )
        write_durably(staged / "episode" / "episode.json", record.to_line().encode())
        for side, data in images.items():
            write_durably(staged / f"{side}.png", data)
        sync_tree(staged)


def _png(image: Any) -> bytes:
    _, data = cv2.imencode(".png", image)
    return bytes(data)


def _place_of(error: Exception) -> str:
    """The error's message and the innermost line that raised it."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{error} (in {Path(frame.filename).name}:{frame.lineno}, {frame.name})"

"""Floor plans made ready for exploration, and where the next one comes from (``reset(options=...)`` may name it)."""

import logging
import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from slamgym.cad import FloorPlan, PlanSource, check_plan, open_plans
from slamgym.cad.plan_index import PlanIndex
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError, PlanError
from slamgym.core.types import Pose2D
from slamgym.envs.coverage import ReachableFloor
from slamgym.sim import Clutter, ClutterConfig, RobotConfig, SurfaceConfig, make_clutter
from slamgym.sim.contact import SKIN
from slamgym.sim.start import sample_pose, sample_start, start_area
from slamgym.sim.surfaces import Surfaces, furnished_surfaces, wall_surfaces

_logger = logging.getLogger(__name__)

PlansArgument = str | Path | FloorPlan | Sequence[FloorPlan] | PlanSource
"""Types of ``plans``: an argument of :func:`slamgym.cad.open_plans`, a source of plans, or plans."""

KEPT_SITES = 64
"""Sites kept ready. One takes some hundred kilobytes; a run on more plans rebuilds them, at some milliseconds each."""

_TRIES = 100
"""Plans tried in a row before a source counts as useless."""

_MOST_SEARCHED = 1000
"""An id that isn't there is compared with so many others at most."""


class Streams(NamedTuple):
    """Independent sources of randomness of one episode.

    Each is seeded by its own draw from the environment's generator, so a setting that makes one of them draw
    more often (more particles, say) doesn't change the others.
    """

    plan: np.random.Generator
    clutter: np.random.Generator
    start: np.random.Generator
    odometry: np.random.Generator
    lidar: np.random.Generator
    slam: np.random.Generator

    @classmethod
    def spawn(cls, rng: np.random.Generator) -> "Streams":
        """Derive the streams of the next episode."""
        seeds = rng.integers(2**63, size=len(cls._fields))
        return cls(*(np.random.default_rng(int(seed)) for seed in seeds))


class PreparedPlan:
    """A building with what is computed once for it.

    Args:
        plan: The building.
        robot: The robot that will explore it.
        surfaces: What the scanner sees it made of.
        clutter: Furniture and people.
    """

    def __init__(
        self,
        plan: FloorPlan,
        robot: RobotConfig,
        surfaces: SurfaceConfig | None = None,
        clutter: Clutter | None = None,
    ) -> None:
        self.plan = plan
        self.clutter = clutter or Clutter()
        self._robot = robot
        self._surface_config = surfaces or SurfaceConfig()

    def furnished(self, clutter: Clutter) -> "PreparedPlan":
        """The same building with other furniture and people."""
        other = PreparedPlan(self.plan, self._robot, self._surface_config, clutter)
        other._wall_surfaces = self._wall_surfaces
        return other

    @cached_property
    def surfaces(self) -> Surfaces:
        """The materials of walls and furniture."""
        return furnished_surfaces(
            self._wall_surfaces, self.clutter.segments(), self._surface_config
        )

    @cached_property
    def _wall_surfaces(self) -> Surfaces:
        return wall_surfaces(self.plan, self._surface_config)

    @cached_property
    def _start_area(self) -> shapely.Polygon:
        return start_area(self.plan, self._robot)

    @cached_property
    def floor(self) -> ReachableFloor:
        """Floor that can be seen."""
        return ReachableFloor(self.plan, self._robot.radius, self.clutter.passages)

    def sample_start(self, rng: np.random.Generator) -> Pose2D:
        """Draw a start as :func:`slamgym.sim.sample_start` does."""
        if self.clutter.passages is None:
            return sample_pose(self._start_area, rng)
        return sample_start(self.plan, self._robot, rng, self.clutter)


class PlanCache:
    """Draws floor plans and keeps the latest ones ready.

    A plan that was checked once is not checked again.

    Args:
        plans: Where the plans come from.
        robot: The robot that will explore them.
        surfaces: What the robot's scanner sees them made of.
        kept: So many are kept.
    """

    def __init__(
        self,
        plans: PlansArgument,
        robot: RobotConfig,
        surfaces: SurfaceConfig | None = None,
        kept: int = KEPT_SITES,
    ) -> None:
        self._source = _open(plans)
        self._kept = kept
        self._robot = robot
        self._surfaces = surfaces
        self._plan_cache: OrderedDict[str, PreparedPlan] = OrderedDict()
        self._refused: dict[str, PlanError] = {}

    def draw(self, rng: np.random.Generator) -> PreparedPlan:
        """A plan drawn evenly from the source; one that can't be explored is logged and drawn again.

        Raises:
            PlanError: If a hundred plans in a row can't be explored.
        """
        error: PlanError | None = None
        for _ in range(_TRIES):
            plan_id = self._source.ids[int(rng.integers(len(self._source)))]
            if plan_id in self._refused:
                error = self._refused[plan_id]
                continue
            try:
                return self.named(plan_id)
            except PlanError as refusal:
                _logger.warning("left out: %s", refusal)
                # Without its traceback, whose frames would keep the plan.
                self._refused[plan_id] = error = refusal.with_traceback(None)
        assert error is not None
        raise PlanError(
            error.path,
            f"{error.reason} (and {_TRIES} plans drawn in a row can't be explored either)",
        )

    def choose_site(
        self, wanted: "ResetOptions", team: Sequence[Streams], clutter: ClutterConfig
    ) -> tuple[PreparedPlan, list[Pose2D]]:
        """A building, furnished and populated where the settings want it, and where its robots start.

        Args:
            wanted: The plan or its id, and the starts; what is left out is drawn.
            team: Sources of randomness of each robot; the first one's choose the building.
            clutter: Furniture and people.

        Raises:
            ConfigError: If the source has no such plan, or the starts aren't one for each robot, apart from each other.
            PlanError: If it can't be explored, or has no room for so many robots.
        """
        streams = team[0]
        plan = wanted.plan
        if plan is None:
            prepared = self.draw(streams.plan)
        elif isinstance(plan, FloorPlan):
            prepared = self.of(plan)
        else:
            prepared = self.named(plan)
        if not clutter.is_empty:
            drawn = make_clutter(prepared.plan, streams.clutter, clutter, self._robot)
            prepared = prepared.furnished(drawn)
        if wanted.starts:
            return prepared, self._given_starts(wanted.starts, len(team))
        starts: list[Pose2D] = []
        for own in team:
            starts.append(self._start_apart(prepared, starts, own.start))
        return prepared, starts

    def _given_starts(self, starts: Sequence[Pose2D], count: int) -> list[Pose2D]:
        """Starts that the caller has chosen.

        Raises:
            ConfigError: If they aren't one for each robot, or are so near to each other that robots would touch.
        """
        if len(starts) != count:
            raise ConfigError(
                f"the reset option 'start' must give {count} poses, one for each robot, not {len(starts)}"
            )
        for k, start in enumerate(starts):
            if self._nearest(start, starts[:k]) < 2.0 * self._robot.radius:
                raise ConfigError(f"the start {tuple(start)} is on another robot; choose another")
        return list(starts)

    def _start_apart(
        self, prepared: PreparedPlan, others: Sequence[Pose2D], rng: np.random.Generator
    ) -> Pose2D:
        """Draw a start that isn't on another robot's."""
        for _ in range(_TRIES):
            start = prepared.sample_start(rng)
            if self._nearest(start, others) >= 2.0 * (self._robot.radius + SKIN):
                return start
        raise PlanError(prepared.plan.where, f"there is no room for {len(others) + 1} robots in it")

    @staticmethod
    def _nearest(start: Pose2D, others: Sequence[Pose2D]) -> float:
        """Distance of a start from the nearest of others [m]."""
        return min((math.dist(start[:2], other[:2]) for other in others), default=math.inf)

    def named(self, plan_id: str) -> PreparedPlan:
        """A plan by its id.

        Raises:
            ConfigError: If the source has no such plan.
            PlanError: If it can't be explored.
        """
        if plan_id in self._plan_cache:
            self._plan_cache.move_to_end(plan_id)
            return self._plan_cache[plan_id]
        try:
            plan = self._source.load(plan_id)
        except KeyError:
            ids = self._source.ids
            if len(ids) > _MOST_SEARCHED:
                raise ConfigError(
                    f"there is no plan {plan_id!r}; the source has {len(ids)} plans, as {ids[0]!r}"
                ) from None
            raise ConfigError(f"there is no plan {plan_id!r}; {suggest(plan_id, ids)}") from None
        return self._keep(plan_id, plan)

    def of(self, plan: FloorPlan) -> PreparedPlan:
        """A plan that the caller has.

        Raises:
            PlanError: If it can't be explored.
        """
        prepared = self._plan_cache.get(plan.id)
        if prepared is not None and prepared.plan is plan:
            return prepared
        return self._keep(plan.id, plan)

    def _keep(self, key: str, plan: FloorPlan) -> PreparedPlan:
        check_plan(plan, self._robot.radius)
        prepared = PreparedPlan(plan, self._robot, self._surfaces)
        self._plan_cache[key] = prepared
        self._plan_cache.move_to_end(key)
        if len(self._plan_cache) > self._kept:
            self._plan_cache.popitem(last=False)
        return prepared


def listed_plans(plans: Sequence[FloorPlan]) -> PlanSource:
    """Plans at hand as a source."""
    for plan in plans:
        if not isinstance(plan, FloorPlan):
            raise ConfigError(f"a list of plans must hold FloorPlans, not {plan!r}")
    by_id = {plan.id: plan for plan in plans}
    if not plans or len(by_id) < len(plans):
        raise ConfigError("plans must hold at least one plan, and their ids must differ")
    return PlanIndex({plan_id: (plan_id,) for plan_id in by_id}, by_id.__getitem__)


def _open(plans: PlansArgument) -> PlanSource:
    if isinstance(plans, FloorPlan):
        return listed_plans([plans])
    if isinstance(plans, str | Path):
        return open_plans(plans)
    if isinstance(plans, list | tuple):
        return listed_plans(plans)
    if hasattr(plans, "load") and hasattr(plans, "ids"):
        return plans
    raise ConfigError(
        f"plans must name, hold or be floor plans, not {plans!r}; see slamgym.cad.open_plans"
    )


RESET_OPTIONS = ("plan", "start")
"""What ``reset(options=...)`` may name."""


class ResetOptions(NamedTuple):
    """Options of an episode; what is left out is drawn."""

    plan: str | FloorPlan | None = None
    starts: tuple[Pose2D, ...] = ()  # of each robot in the building

    @classmethod
    def read(cls, options: Mapping[str, Any] | None) -> "ResetOptions":
        """Check the options of a reset.

        Raises:
            ConfigError: If one is unknown or of a wrong kind.
        """
        options = options or {}
        for name in options:
            if name not in RESET_OPTIONS:
                raise ConfigError(f"unknown reset option {name!r}; {suggest(name, RESET_OPTIONS)}")
        plan = options.get("plan")
        if plan is not None and not isinstance(plan, str | FloorPlan):
            raise ConfigError(f"the reset option 'plan' must be an id or a FloorPlan, not {plan!r}")
        start = options.get("start")
        if start is None:
            return cls(plan)
        try:
            one = np.ndim(start) == 1
            poses = [start] if one else start
            starts = tuple(Pose2D(*map(float, pose)) for pose in poses)
        except (TypeError, ValueError):
            starts = ()
        if not starts:
            raise ConfigError(f"the reset option 'start' must be (x, y, theta), not {start!r}")
        return cls(plan, starts)

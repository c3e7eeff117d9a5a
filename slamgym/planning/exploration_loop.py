"""The exploration loop: offers frontiers, drives to the chosen one, and says when the next choice is due.

Every frontier explorer is this loop and a rule that scores the candidates: the hand-written rules, a trained
policy, and the environment that policies are trained in, so they differ in what they choose, not in how they
drive. Main path of a control step: :meth:`ExplorationLoop.observe` takes over the map and the clock; while it says
that a choice is due, :meth:`ExplorationLoop.choose` is given one of the :attr:`ExplorationLoop.candidates`;
:meth:`ExplorationLoop.command` drives.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from slamgym.core.config import Count, Positive, Settings, Within
from slamgym.core.types import ByteArray, GridFrame, Observation, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.blacklist import SAME_CENTROID, Blacklist
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import NO_INFORMATION
from slamgym.planning.exploration_progress import LastChoice, MapGrowth, TargetProgress
from slamgym.planning.frontier_candidates import (
    FrontierCandidate,
    frontiers_in_reach,
    make_candidates,
)
from slamgym.planning.frontiers import Frontier, fits_through
from slamgym.planning.navigator import STOP, Goal, GoalStatus, Navigator, NavigatorConfig
from slamgym.planning.promise import Promise, is_kept
from slamgym.planning.recovery import RELAXED_FOOTPRINTS, RecoveryBehaviours

_NEAR_BY = 1.0
"""Driving farther than this shows that the robot can drive [m]."""
_STALL_TIME = 40.0
"""If the map hasn't grown for so long, choices are no longer reconsidered while driving [s]: a policy that
changes its mind for ever would never arrive."""
_FUTILE_GOALS = 12
"""So many frontiers in a row that added nothing to the map end the exploration: no map of a home needs as many."""
_HOME = 100.0
"""Known floor of a usual home [m2]; more may be a hall."""


class ExplorationLoopConfig(Settings, section="loop"):
    """Settings for offering frontiers and driving to them."""

    max_candidates: Count = 16
    """K: so many frontiers are offered at most, those with the shortest paths."""
    horizon: Positive = 6.0
    """A choice is reconsidered with the first map after so long, even if its frontier is still there [s]."""
    min_frontier_size: Positive = 0.5
    """Frontiers shorter than this are left for the end [m]."""
    split_extent: Annotated[float, Within(gt=0.0, infinite=True)] = 3.0
    """A frontier that extends farther than this is offered in parts [m]."""
    progress_timeout: Positive = 30.0
    """A frontier that the robot doesn't come nearer to for so long is given up [s]."""
    last_frontier_size: float = 0.25
    """Once nothing larger is left, frontiers down to this size are offered too [m]."""
    promise: Promise | None = None
    """The exploration ends as soon as the map keeps this promise; without one when nothing is left to try."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


@dataclass
class _Belief:
    """The newest observation."""

    frame: GridFrame  # of the map
    pose: Pose2D = Pose2D(0.0, 0.0, 0.0)
    time: float = 0.0  # [s]
    scan: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    cells: ByteArray | None = None  # the map


class ExplorationLoop:
    """One robot's exploration by chosen frontiers.

    Args:
        context: What the environment says about the robot and its map.
        config: Settings.

    Attributes:
        candidates: What may be chosen now, the shortest path first; at most ``config.max_candidates``.
        num_frontiers: How many frontiers there were before the list was cut.
        wanted: The frontiers that are to be visited sooner or later, the candidates' among them.
        finished: Nothing that the robot can get to is left to explore, or the promise is kept.
        target: The frontier that the robot drives to, None if there is none.
    """

    def __init__(
        self, context: ExplorerContext, config: ExplorationLoopConfig | None = None
    ) -> None:
        self.context = context
        self.config = config or ExplorationLoopConfig()
        self.num_frontiers = 0
        self.finished = False
        self._belief = _Belief(context.frame)
        self._growth = MapGrowth()
        self._has_tried_all = False  # whether the last search of candidates had the last footprint
        self._recovery = RecoveryBehaviours()
        self._begin(LastChoice())

    def _begin(self, choice: LastChoice) -> None:
        """Begin without anything that is noted by its place on the map."""
        self.navigator = Navigator(self.context, self.config.navigator)
        self.candidates: list[FrontierCandidate] = []
        self.wanted: list[Frontier] = []  # to be visited sooner or later
        self.target: FrontierCandidate | None = None
        self._choice = choice
        self._progress = TargetProgress()
        self._blacklist = Blacklist(0.5 * self.context.frame.resolution)
        self._recovery.start(self.navigator)

    @property
    def pose(self) -> Pose2D:
        """The newest believed pose."""
        return self._belief.pose

    @property
    def time(self) -> float:
        """The newest time [s]."""
        return self._belief.time

    @property
    def known_area(self) -> float:
        """Area of the map's known cells [m2]."""
        return self._growth.known_area

    @property
    def reached(self) -> int:
        """Number of goals that the robot got to."""
        return self._growth.reached

    @property
    def round(self) -> int:
        """0 at first; counts the relaxed footprints tried at the end."""
        return self._recovery.round

    # The three steps of the protocol.

    def observe(self, observation: Observation) -> bool:
        """Take over an observation; returns True if a choice is due.

        Args:
            observation: Of an environment whose map is the global one: ``"map"`` uint8 (1, H, W), ``"scan"``
                (num_beams,) [m], ``"pose"`` (3,) in the map frame, ``"time"`` (1,) [s]. The map may be an
                :class:`OccupancyGrid`, which may grow and move as long as its cells stay on one lattice.
        """
        belief = self._belief
        pose, time = Pose2D(*observation["pose"].tolist()), float(observation["time"][0])
        driven = self.context.max_linear * max(time - belief.time, self.context.control_step)
        is_corrected = math.dist(pose[:2], belief.pose[:2]) > driven + SAME_CENTROID
        belief.pose, belief.time, belief.scan = pose, time, observation["scan"]
        if is_corrected and belief.cells is not None and not self.finished:
            # The last map that was published is still the old one.
            self._begin(LastChoice(is_stale=False, settles_at=self._next_map_at()))
            self._growth.grown_to = 0.0  # corrected maps may be smaller
        self._recovery.note_time(belief.time)
        self._take_map(observation["map"])
        self._close_goal()
        if self._recovery.is_turning or self.finished:
            return False
        if self._wants_choice():
            self._offer()
        return bool(self.candidates) and self._choice.is_open

    def choose(self, index: int) -> bool:
        """Drive to a candidate.

        Args:
            index: Of :attr:`candidates`.

        Returns:
            True if a path leads there. Otherwise the candidate is taken off the list, and as long as others
            are left a choice is still due.

        Raises:
            IndexError: If there is no such candidate.
        """
        candidate = self.candidates[index]
        same = self.target is not None and math.dist(self.target.target, candidate.target) < 0.01
        if not (same and self.navigator.is_active) and not self._set_goal(candidate):
            del self.candidates[index]
            self._give_up(candidate)
            self._choice.is_stale = not self.candidates
            return False
        self.target = candidate
        self._choice.made_at, self._choice.is_open = self.time, False
        return True

    def command(self) -> Twist2D:
        """Velocity for the next control step."""
        pose, scan, time = self._belief.pose, self._belief.scan, self._belief.time
        if self._recovery.is_turning:
            return self._recovery.turn(pose)
        if self.finished:
            return STOP
        command = self.navigator.step(pose, scan, time)
        if self.target is None and self.navigator.status is GoalStatus.SUCCEEDED:
            self.navigator.cancel()
            self._growth.reached += self.round > 0  # before, it looked around
            self._choice.is_stale = True
            if self._recovery.is_looking:
                self._choice.settles_at = self._next_map_at()
        return command

    # After the end.

    def unreached(self) -> list[FrontierCandidate]:
        """Frontiers that were given up on the way and are still on the map, or keep others from being offered."""
        costmap, space = self.navigator.costmap, self.navigator.reachable
        size, split = self.config.last_frontier_size, self.config.split_extent
        if costmap is None or space is None:
            return []
        found = frontiers_in_reach(costmap, space, self.pose, size, split)
        return self._blacklist.unreached(costmap, [one.frontier.centroid for one in found])

    def forgive(self) -> None:
        """Go on after the end: offer again what was given up on the way, and forget what stopped the robot there.

        First it drives to a place near by, which shows that it still can.
        """
        blacklist = self._blacklist
        blacklist.forgive()
        self._begin(LastChoice())
        self._blacklist, self.finished = blacklist, False
        self.navigator.update_map(self.known_map(), self.pose, self.time)
        costmap, space = self.navigator.costmap, self.navigator.reachable
        if costmap is not None and space is not None:
            # In the order of the search, the nearest first.
            places = costmap.frame.to_points(
                *np.divmod(space.order[: space.num_centre], costmap.frame.width_px)
            )
            away = places[np.hypot(*(places - self.pose[:2]).T) > _NEAR_BY].tolist()
            if away:
                self.navigator.set_goal(Goal(*away[0]), self.pose, self.time)

    # The parts of observe.

    def _take_map(self, published: ByteArray | OccupancyGrid) -> None:
        """Hand a newly published map to the navigation stack."""
        if isinstance(published, OccupancyGrid):
            cells, self._belief.frame = published.cells, published.frame
        else:
            cells, self._belief.frame = published, self.context.frame
        # The environment publishes a new read-only array for a new map; any other array may have been
        # written to in place, so it is compared.
        last = self._belief.cells
        if cells is last and not cells.flags.writeable:
            return
        unchanged = cells.flags.writeable and last is not None and np.array_equal(cells, last)
        self._belief.cells = cells.copy() if cells.flags.writeable else cells
        if unchanged:
            return
        self.navigator.update_map(self.known_map(), self.pose, self.time)
        self._choice.is_new_map = True
        costmap = self.navigator.costmap
        if costmap is not None:
            known = np.count_nonzero(costmap.costs != NO_INFORMATION)
            self._growth.note(float(known) * self.context.frame.resolution**2, self.time)

    def _next_map_at(self) -> float:
        """Time when the next map is surely there [s]."""
        return self.time + self.context.map_update_interval + self.context.control_step

    def _close_goal(self) -> None:
        """Blacklist a frontier whose goal ended.

        One that was reached is blacklisted too: if it is gone that does no harm, and if it is still there then
        going there again would not help.
        """
        status = self.navigator.status
        if self.target is None or status not in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED):
            return
        self._growth.reached += status is GoalStatus.SUCCEEDED
        self._growth.futile = (
            0 if self._growth.grown_at >= self._choice.made_at else self._growth.futile + 1
        )
        if self.navigator.reason == "stuck":
            self.navigator.block_ahead(self.pose, self.time)
        self._drop_target()
        self._choice.settles_at = self._next_map_at()

    def _wants_choice(self) -> bool:
        """True if the candidates have to be searched again."""
        choice, time = self._choice, self.time
        if self.target is None:
            changed = choice.is_stale or choice.is_new_map or time >= choice.settles_at
            return changed and not self.navigator.is_active
        if not choice.is_new_map:
            return False
        distance = math.dist(self.target.target, self.pose[:2])
        waited = self._progress.waited(self.target.target, distance, time)
        if self.context.drives and waited > self.config.progress_timeout:
            self.navigator.block_ahead(self.pose, time)
            self._drop_target()
            return True
        if not self._is_still_there(self.target):
            return True
        is_stalled = time - self._growth.grown_at > _STALL_TIME
        return not is_stalled and time - choice.made_at >= self.config.horizon - 1e-6

    def _offer(self) -> None:
        """Search the candidates; without any, try what is left to try."""
        self._choice.is_new_map, self._choice.is_stale, self._choice.is_open = False, False, True
        self._has_tried_all = self.round == len(RELAXED_FOOTPRINTS)
        self.candidates, self.num_frontiers, self.wanted = [], 0, []
        costmap, space = self.navigator.costmap, self.navigator.reachable
        if costmap is not None and space is not None and self._growth.futile < _FUTILE_GOALS:
            last = self.config.last_frontier_size if self.round else math.inf
            size, split = min(self.config.min_frontier_size, last), self.config.split_extent
            keep = self.target.target if self.target else None
            found = frontiers_in_reach(costmap, space, self.pose, size, split)
            ahead = [one for one in found if not self._blacklist.holds(one.frontier.centroid)]
            # The next round offers again what was given up in the first.
            self.wanted = [one.frontier for one in (ahead if self.round else found)]
            # A robot that sees no wall soon doesn't know where it is: the middle of a hall comes after its walls.
            if self.known_area > _HOME:
                near = {one.whole for one in ahead if one.is_by_wall}
                ahead = [one for one in ahead if one.is_by_wall or one.whole not in near]
            self.num_frontiers = len(ahead)
            self.candidates = make_candidates(
                costmap, space, ahead, self.config.max_candidates, keep
            )
        if not self.candidates:
            self.target = None
            self.navigator.cancel()
            self._recover()
        promise = None if self.finished else self.config.promise
        if promise is not None and is_kept(promise, self.ways_on(), self.known_area):
            self.finish()

    def finish(self) -> None:
        """End the exploration, as what is left is worth no visit; but first look at what somebody may have closed."""
        waits = self.navigator.is_active or self.time < self._choice.settles_at
        is_looking = self.target is None and self._recovery.is_looking and waits
        self.finished = not (is_looking or self._recovery.look_again(self.pose, self.time))
        if self.finished:
            self._blacklist.clear()  # so nothing is left to try again
        else:
            self.candidates, self.target = [], None

    def known_map(self) -> OccupancyGrid:
        """The newest map, on the whole canvas."""
        cells, frame = self._belief.cells, self._belief.frame
        assert cells is not None, "there is a map from the first observation on"
        return OccupancyGrid(cells.reshape(frame.shape), frame)

    def ways_on(self) -> list[Frontier] | None:
        """Frontiers that the robot fits through and that the exploration means to visit, now or in a later round.

        None where the robot finds no place on the map, before open space that it doesn't show, and while nothing is
        offered but the next search, with another footprint or a newer map, may find something.
        """
        costmap, radius = self.navigator.costmap, self.context.robot_radius
        if costmap is None or self.navigator.reachable is None:
            return None
        if not (self.candidates or self._has_tried_all) or self._recovery.has_open_space(
            self.known_map()
        ):
            return None
        return [one for one in self.wanted if fits_through(costmap, one, radius)]

    def _drop_target(self) -> None:
        assert self.target is not None
        self._recovery.note_given_up(self.pose, self._belief.scan)
        if self.navigator.status is not GoalStatus.SUCCEEDED:
            self.navigator.keep_obstacles(self.pose, self.time)
        self._give_up(self.target)
        self._choice.is_stale = True

    def _give_up(self, candidate: FrontierCandidate) -> None:
        """Blacklist a frontier, and drive nowhere."""
        self._blacklist.add(candidate, self.navigator.status is GoalStatus.SUCCEEDED)
        self.target = None
        self.navigator.cancel()

    def _set_goal(self, candidate: FrontierCandidate) -> bool:
        """Send a goal to the navigation stack; False if no path leads there."""
        frontier = candidate.frontier
        for target in dict.fromkeys((candidate.target, frontier.middle, frontier.nearest)):
            self.navigator.set_goal(Goal(*target, look_at=frontier.middle), self.pose, self.time)
            if self.navigator.is_active:
                return True
        return False

    def _is_still_there(self, candidate: FrontierCandidate) -> bool:
        """True if enough cells of a frontier are still unknown on the newest map."""
        costmap, checked = self.navigator.costmap, self._choice.checked
        assert costmap is not None
        if checked is not None and checked[0] is costmap and checked[1] is candidate:
            return True
        is_there = candidate.is_still_there(costmap)
        self._choice.checked = (costmap, candidate) if is_there else None
        return is_there

    def _recover(self) -> None:
        """Begin the recovery behaviour that is next, or end."""
        if self.navigator.is_active or self.time < self._choice.settles_at:
            return  # looking again, or the map doesn't show yet what the last goal brought
        self._growth.futile = 0
        self._choice.is_stale = True
        rounds = self.round
        self.finished = not self._recovery.attempt(self.known_map(), self.pose, self.time)
        if self.round > rounds == 0:
            # What was given up may have become possible: people walk on and maps get better.
            self._blacklist.clear()

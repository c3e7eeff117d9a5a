"""The exploration loop: offers frontiers, drives to the chosen one, and says when the next choice is due.

Every frontier explorer is this loop and a rule that scores the candidates, so they differ in what they choose, not in
how they drive. In a control step :meth:`ExplorationLoop.observe` takes over the map and the clock; while it says that a
choice is due, :meth:`ExplorationLoop.choose` is given one of the :attr:`ExplorationLoop.candidates`;
:meth:`ExplorationLoop.command` drives.
"""

from dataclasses import field
from typing import Annotated

from slamgym.core.config import Count, Positive, Settings, Within
from slamgym.core.types import ByteArray, Observation, OccupancyGrid, Pose2D, Twist2D
from slamgym.planning.blacklist import SAME_CENTROID, Blacklist
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import Costmap
from slamgym.planning.exploration_progress import LastChoice, MapGrowth, TargetProgress, Trail
from slamgym.planning.frontier_candidates import (
    FrontierCandidate,
    frontiers_in_reach,
    make_candidates,
    walls_first,
)
from slamgym.planning.frontier_goals import send_near_by, send_to
from slamgym.planning.frontiers import Frontier, Reachable, fits_through
from slamgym.planning.loop_belief import LoopBelief
from slamgym.planning.loop_state import LoopEvent, LoopState, next_state
from slamgym.planning.navigator import STOP, GoalStatus, Navigator, NavigatorConfig
from slamgym.planning.promise import SMALLEST_CALIBRATED, Promise, is_kept
from slamgym.planning.recovery import RELAXED_FOOTPRINTS, RecoveryBehaviours

_STALL_TIME = 40.0
"""Without growth of the map for so long, choices stand while driving [s]: who changes its mind never arrives."""
_FUTILE_GOALS = 12
"""So many frontiers in a row that added nothing to the map end the exploration: no map of a home needs as many."""


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
    """A frontier is given up to which the robot comes no nearer, straight or along its path, for so long [s]."""
    last_frontier_size: float = 0.25
    """Once nothing larger is left, frontiers down to this size are offered too [m]."""
    promise: Promise | None = None
    """The exploration ends as soon as the map keeps this promise; without one when nothing is left to try."""
    navigator: NavigatorConfig = field(default_factory=NavigatorConfig)
    """Navigation stack."""


class ExplorationLoop:
    """One robot's exploration by chosen frontiers.

    Args:
        context: What the environment says about the robot and its map.
        config: Settings.

    Attributes:
        state: What the loop is at.
        candidates: What may be chosen now, the shortest path first; at most ``config.max_candidates``.
        num_frontiers: How many frontiers there were before the list was cut.
        wanted: The frontiers that are to be visited sooner or later, the candidates' among them.
        target: The frontier that the robot drives to, None if there is none.
        belief: Pose, scans and map.
        growth: Of the map, and how many goals were reached.
    """

    def __init__(
        self, context: ExplorerContext, config: ExplorationLoopConfig | None = None
    ) -> None:
        self.context = context
        self.config = config or ExplorationLoopConfig()
        self.state = LoopState.SEARCHING
        self.num_frontiers = 0
        self.belief = LoopBelief(context)
        self.growth = MapGrowth()
        self._trail = Trail()
        self._searched_round = 0  # the round of the last search of candidates
        self._recovery = RecoveryBehaviours()
        self._begin(LastChoice())

    def _begin(self, choice: LastChoice) -> None:
        """Begin without anything that is noted by its place on the map."""
        self.navigator = Navigator(self.context, self.config.navigator)
        self.candidates: list[FrontierCandidate] = []
        self.wanted: list[Frontier] = []
        self.target: FrontierCandidate | None = None
        self._choice = choice
        self._progress = TargetProgress()
        self._blacklist = Blacklist(0.5 * self.context.frame.resolution)
        self._recovery.start(self.navigator)

    def _enter(self, event: LoopEvent) -> None:
        """Go to the state that an event leads to."""
        self.state = next_state(self.state, event)

    @property
    def finished(self) -> bool:
        """True if nothing that the robot can get to is left to explore, or the promise is kept."""
        return self.state is LoopState.FINISHED

    @property
    def pose(self) -> Pose2D:
        """The newest believed pose."""
        return self.belief.pose

    @property
    def time(self) -> float:
        """The newest time [s]."""
        return self.belief.time

    @property
    def known_area(self) -> float:
        """Area of the map's known cells [m2]."""
        return self.growth.known_area

    @property
    def may_stop(self) -> bool:
        """True if there is a promise, and the map is large enough that one may be kept."""
        return self.config.promise is not None and self.known_area >= SMALLEST_CALIBRATED

    @property
    def round(self) -> int:
        """0 at first; counts the relaxed footprints tried at the end."""
        return self._recovery.round

    def observe(self, observation: Observation) -> bool:
        """Take over an observation; returns True if a choice is due.

        Args:
            observation: Of an environment whose map is the global one: ``"map"`` uint8 (1, H, W), ``"scan"``
                (num_beams,) [m], ``"pose"`` (3,) in the map frame, ``"time"`` (1,) [s], in a team ``"mates"``. The map
                may be an :class:`OccupancyGrid`, which may grow and move on its lattice of cells.
        """
        self._take_pose(observation)
        self._recovery.note_time(self.time)
        self._take_map(observation["map"])
        self._close_goal()
        if self._recovery.is_turning or self.finished:
            return False
        if self._wants_search():
            self._offer()
            # Also where the promise has just ended the exploration: this choice is the last one.
            return bool(self.candidates)
        return self.state is LoopState.CHOOSING

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
        is_on_the_way = self.navigator.is_active and candidate.is_same_place(self.target)
        if not (is_on_the_way or send_to(self.navigator, candidate, self.pose, self.time)):
            del self.candidates[index]
            self._give_up(candidate)
            if not self.candidates:
                self._enter(LoopEvent.GOAL_ENDED)
            return False
        self.target = candidate
        self._choice.made_at = self.time
        self._enter(LoopEvent.CHOSEN)
        return True

    def pass_over(self, index: int) -> None:
        """Leave a candidate out until the map has changed around it; a promise still counts it as a way on."""
        candidate = self.candidates.pop(index)
        costmap = self.navigator.costmap
        assert costmap is not None, "there is a candidate, so there was a map"
        self._blacklist.pass_over(candidate, costmap)
        if not self.candidates or candidate.is_same_place(self.target):
            self.target = None
            self.navigator.cancel()
        if not self.candidates:
            self._enter(LoopEvent.GOAL_ENDED)

    def command(self) -> Twist2D:
        """Velocity for the next control step."""
        belief = self.belief
        if self._recovery.is_turning:
            return self._recovery.turn(belief.pose)
        if self.finished:
            return STOP
        command = self.navigator.step(belief.pose, belief.scan, belief.time)
        if self.target is None and self.navigator.status is GoalStatus.SUCCEEDED:
            self._close_recovery()
        return command

    def unreached(self) -> list[FrontierCandidate]:
        """Frontiers that were given up on the way and are still on the map, or keep others from being offered."""
        costmap = self.navigator.costmap
        space = self.navigator.reachable
        if costmap is None or space is None:
            return []
        found = frontiers_in_reach(
            costmap, space, self.pose, self.config.last_frontier_size, self.config.split_extent
        )
        return self._blacklist.unreached(costmap, [one.frontier.centroid for one in found])

    def forgive(self) -> None:
        """Go on after the end: offer again what was given up on the way, and forget what stopped the robot there.

        First it drives to a place near by, which shows that it still can.
        """
        blacklist = self._blacklist
        blacklist.forgive()
        self._begin(LastChoice())
        self._blacklist = blacklist
        self._enter(LoopEvent.FORGIVEN)
        self.navigator.update_map(self.known_map(), self.pose, self.time)
        send_near_by(self.navigator, self.pose, self.time)

    def finish(self) -> None:
        """End the exploration, as what is left is worth no visit; but first look at what somebody may have closed."""
        waits = self.navigator.is_active or self.time < self._choice.settles_at
        is_looking = self.target is None and self._recovery.is_looking and waits
        if is_looking or self._recovery.look_again(self.pose, self.time):
            self.candidates = []
            self.target = None
            self._enter(LoopEvent.LOOKING_AGAIN)
        else:
            self._blacklist.clear()  # so nothing is left to try again
            self._enter(LoopEvent.ENDED)

    def known_map(self) -> OccupancyGrid:
        """The newest map, on the whole canvas."""
        return self.belief.known_map()

    def ways_on(self) -> list[Frontier] | None:
        """Frontiers that the robot fits through and that the exploration means to visit, now or in a later round.

        None where the robot finds no place on the map, or no way back on it to where it has been, before open space
        that it doesn't show, and while nothing is offered but the next search, with another footprint or a newer map,
        may find something.
        """
        costmap = self.navigator.costmap
        space = self.navigator.reachable
        if costmap is None or space is None or self._trail.is_cut_off(costmap, space):
            return None
        if not self.candidates and self._searched_round < len(RELAXED_FOOTPRINTS):
            return None
        if self._recovery.has_open_space(self.known_map()):
            return None
        radius = self.context.robot_radius
        return [one for one in self.wanted if fits_through(costmap, one, radius)]

    def _take_pose(self, observation: Observation) -> None:
        """Take over all but the map; on a corrected map begin anew, with the next one that is published."""
        last_time = self.time
        moved = self.belief.take_pose(observation)
        self._trail.note(self.pose)
        passed = max(self.time - last_time, self.context.control_step)
        is_corrected = moved > self.context.max_linear * passed + SAME_CENTROID
        if is_corrected and self.belief.has_map and not self.finished:
            self._begin(LastChoice(settles_at=self._next_map_at()))
            self._enter(LoopEvent.CORRECTED)
            self.growth.grown_to = 0.0  # corrected maps may be smaller

    def _take_map(self, published: ByteArray | OccupancyGrid) -> None:
        """Hand a newly published map to the navigation stack."""
        if not self.belief.take_map(published):
            return
        self.navigator.update_map(self.known_map(), self.pose, self.time)
        self._choice.is_outdated = True
        if self.navigator.costmap is not None:
            self.growth.note(self.navigator.costmap.known_area, self.time)

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
        self.growth.note_goal(self._choice.made_at, status is GoalStatus.SUCCEEDED)
        if self.navigator.reason == "stuck":
            self.navigator.block_ahead(self.pose, self.time)
        self._drop_target(self.target)
        self._choice.settles_at = self._next_map_at()

    def _wants_search(self) -> bool:
        """True if the candidates have to be searched again."""
        if self.target is not None:
            return self._choice.is_outdated and self._reconsiders(self.target)
        if self.navigator.is_active:
            return False
        is_settled = self.time >= self._choice.settles_at
        return self.state is LoopState.SEARCHING or self._choice.is_outdated or is_settled

    def _reconsiders(self, target: FrontierCandidate) -> bool:
        """True if there may be a better choice on a newer map; gives up a target without progress towards it."""
        waited = self._progress.waited(target.target, self.navigator, self.pose, self.time)
        if self.context.drives and waited > self.config.progress_timeout:
            self.navigator.block_ahead(self.pose, self.time)
            self._drop_target(target)
            return True
        costmap = self.navigator.costmap
        assert costmap is not None, "there is a target, so there was a map"
        if not self._choice.is_still_there(costmap, target):
            return True
        is_stalled = self.time - self.growth.grown_at > _STALL_TIME
        return not is_stalled and self.time - self._choice.made_at >= self.config.horizon - 1e-6

    def _offer(self) -> None:
        """Search the candidates; without any, try what is left to try."""
        self._choice.is_outdated = False
        self._searched_round = self.round
        self.candidates = []
        self.num_frontiers = 0
        self.wanted = []
        costmap = self.navigator.costmap
        space = self.navigator.reachable
        if costmap is not None and space is not None and self.growth.futile < _FUTILE_GOALS:
            self._search(costmap, space)
        if self.candidates:
            self._enter(LoopEvent.OFFERED)
        else:
            self._enter(LoopEvent.NOTHING_FOUND)
            self.target = None
            self.navigator.cancel()
            self._recover()
        promise = None if self.finished else self.config.promise
        if promise is not None and is_kept(promise, self.ways_on(), self.known_area):
            self.finish()

    def _search(self, costmap: Costmap, space: Reachable) -> None:
        """Search the frontiers, and make candidates of those that come first."""
        min_size = self.config.min_frontier_size
        if self.round:
            min_size = min(min_size, self.config.last_frontier_size)
        found = frontiers_in_reach(costmap, space, self.pose, min_size, self.config.split_extent)
        ahead = self._blacklist.without_given_up(found)
        # The next round offers again what was given up in the first.
        wanted = ahead if self.round else found
        self.wanted = [one.frontier for one in wanted]
        ahead = self._blacklist.without_passed_over(ahead, costmap)
        ahead = walls_first(ahead, self.known_area)
        self.num_frontiers = len(ahead)
        keep = self.target.target if self.target else None
        self.candidates = make_candidates(costmap, space, ahead, self.config.max_candidates, keep)

    def _recover(self) -> None:
        """Begin the recovery behaviour that is next, or end."""
        if self.time < self._choice.settles_at:
            return  # the map doesn't show yet what the last goal brought
        self.growth.futile = 0
        is_first_round = self.round == 0
        is_begun = self._recovery.attempt(self.known_map(), self.pose, self.time)
        self._enter(LoopEvent.RECOVERING if is_begun else LoopEvent.ENDED)
        if is_first_round and self.round > 0:
            # What was given up may have become possible: people walk on and maps get better.
            self._blacklist.clear()

    def _drop_target(self, target: FrontierCandidate) -> None:
        """Give up the frontier that the robot drives to, reached or not."""
        self._recovery.note_given_up(self.pose, self.belief.scan)
        if self.navigator.status is not GoalStatus.SUCCEEDED:
            self.navigator.keep_obstacles(self.pose, self.time)
        self._give_up(target)
        self._enter(LoopEvent.GOAL_ENDED)

    def _give_up(self, candidate: FrontierCandidate) -> None:
        """Blacklist a frontier, and drive nowhere."""
        self._blacklist.add(candidate, self.navigator.status is GoalStatus.SUCCEEDED)
        self.target = None
        self.navigator.cancel()

    def _close_recovery(self) -> None:
        """Note that the robot got to a goal that is no frontier."""
        self.navigator.cancel()
        self.growth.reached += self.round > 0  # before, it looked around
        self._enter(LoopEvent.GOAL_ENDED)
        if self._recovery.is_looking:
            self._choice.settles_at = self._next_map_at()

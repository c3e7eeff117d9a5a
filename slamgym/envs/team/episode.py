"""A team explores a building from start to end."""

from collections.abc import Iterator, Sequence

import numpy as np
from gymnasium.utils import seeding

from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Explorer, OccupancyGrid, Pose2D, Trajectory
from slamgym.envs.episode import Episode, EpisodeConfig, MakeExplorer, fitted_env, time_limit
from slamgym.envs.explore_env import explorer_context
from slamgym.envs.plan_cache import ResetOptions
from slamgym.envs.simulation import Actions
from slamgym.envs.team.exploration import TeamExploration
from slamgym.envs.team.maps import joined_about
from slamgym.slam.graph.map_graph import MapGraph
from slamgym.slam.merge.drawing import Picture, paint
from slamgym.slam.merge.joint import tied_loosely

WAKING_AREA = 1.0
"""A robot that was done begins again once it was told of so much more floor or walls [m2]: two steps into a room."""
LOOSE_TIE = np.diag([0.3**2, 0.3**2, 0.05**2])
"""Covariance of where a map lies that shows nothing in common with the others [m2, rad2]."""


def team_steps(
    team: TeamExploration, explorers: Sequence[Explorer], seed: int, wanted: ResetOptions
) -> Iterator[int]:
    """Let explorers drive, one each robot, until all say that they are done or the time is up.

    One that was done begins again when it is told of more.

    Args:
        team: Its state is that of the step yielded last.
        explorers: Whether a robot was done at the end, its ``finished`` says.
        seed: Of the episode.
        wanted: Plan and starts, if they aren't drawn.

    Yields:
        The number of steps so far.
    """
    actions = Actions(team.config)
    rng, _ = seeding.np_random(seed)
    team.begin(rng, wanted)
    most_known = [0.0] * len(team)  # when each said that it was done [m2]
    was_done = [False] * len(team)
    yield 0
    count = 0
    is_over = False
    while not is_over:
        chosen = []
        for index, explorer in enumerate(explorers):
            observation = team.observe(index)
            wakes = False
            if explorer.finished:
                known = team.maps.shared[index].occupancy_grid().known_area
                if not was_done[index]:
                    most_known[index] = max(most_known[index], known)
                wakes = known > most_known[index] + WAKING_AREA
            was_done[index] = explorer.finished
            action, _ = explorer.predict(observation, None, np.array([wakes]))
            chosen.append(action)
        if all(explorer.finished for explorer in explorers):
            return
        outcome = team.step(actions.to_commands(chosen))
        is_over = bool(outcome.truncations.any())
        count += 1
        yield count


def run_team_episode(
    plan: FloorPlan, seed: int, config: EpisodeConfig, make_explorer: MakeExplorer
) -> Episode:
    """Let a team map a building until all are done or the time is up; see :func:`~slamgym.envs.episode.run_episode`.

    Path, odometry and log are the first robot's, in whose frame the merged map is; contacts are those of all.

    Raises:
        PlanError: If there is no room for the robots in the plan.
        ConfigError: If there is no explorer of that name, or the settings end an exploration that is stuck.
    """
    if config.stuck_after is not None:
        raise ConfigError("stuck_after watches one robot; leave it or the team out")
    plan = plan.turned(config.turn_deg)
    env = fitted_env(plan, config.env, config.minutes)
    team = TeamExploration(plan, env)
    context = explorer_context(env)
    explorers = [make_explorer(config.explorer, context, seed) for _ in range(len(team))]
    for _ in team_steps(team, explorers, seed, ResetOptions(plan)):
        pass
    first = team.robots[0]
    log = team.logs[0]
    return Episode(
        plan=plan,
        seed=seed,
        start=first.start,
        slam_map=merged_map(team),
        truth=log.true_trajectory(first.start),
        odometry=Trajectory(log.stamps, log.odometry),
        estimate=first.mapper.trajectory(),
        final_estimate=first.believed_pose,
        geometry=first.scan.geometry,
        log=log,
        finished="explored" if all(one.finished for one in explorers) else "time_limit",
        time_limit=time_limit(plan, config.minutes),
        coverage=team.coverage,
        collisions=sum(robot.collisions for robot in team.robots),
    )


def merged_map(team: TeamExploration) -> OccupancyGrid:
    """The map of all robots whose place on the first one's is known, in its frame: one graph where they have graphs."""
    placed = [(0, Pose2D(0.0, 0.0, 0.0))]
    placed += [(k, place) for k in range(1, len(team)) if (place := team.maps.place(0, k))]
    graph: MapGraph | None = None
    for index, place in placed:
        own = team.robots[index].mapper.graph()
        if own is None:
            grids = [(team.robots[k].mapper.occupancy_grid(), at) for k, at in placed]
            pictures = [Picture(grid, np.array(at)) for grid, at in grids]
            return paint(pictures, pictures[0].grid.frame)
        graph = own if graph is None else _joined(graph, own, place)
    assert graph is not None
    return graph.grid()


def _joined(graph: MapGraph, own: MapGraph, place: Pose2D) -> MapGraph:
    joint = joined_about(graph, own, place)
    if joint is None:
        return tied_loosely(graph, own, np.array(place), LOOSE_TIE)
    return joint.graph

import math
from functools import partial

import numpy as np
import pytest
import shapely

from slamgym.agents.evaluation.trial import TrialConfig, run_trial
from slamgym.agents.oracle import Oracle, OracleConfig
from slamgym.cad import FloorPlan
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.slam import SlamConfig

ENV = ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer()


def corridor_with_rooms():
    """A corridor of 8 m with three rooms of 3 m to one side, each behind a door of 1 m."""
    parts = [shapely.box(0.0, 0.0, 9.4, 1.6)]
    for left in (0.0, 3.2, 6.4):
        parts += [shapely.box(left, 1.7, left + 3.0, 4.7), shapely.box(left + 1.0, 1.5, left + 2.0, 1.8)]
    return FloorPlan("corridor", shapely.union_all(parts))


def begin(plan, start):
    env = ExploreEnv(plan, ENV)
    env.reset(seed=0, options={"plan": plan, "start": start})
    return env, Oracle.of(env)


def test_the_tour_sees_what_was_asked_for_and_each_cell_belongs_to_one_stop():
    _, explorer = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    planner = explorer.building.planner
    unseen = np.ones(len(planner.cells), dtype=bool)
    tour = planner.plan(unseen, (0.8, 0.8))
    cells = np.concatenate([stop.cells for stop in tour])
    assert len(cells) == len(set(cells.tolist()))
    in_rooms = planner._centres[:, 1] > 2.5
    # What the stops don't see must be seen between them: here only parts of the corridor.
    missing = np.setdiff1d(np.flatnonzero(planner.coverable & in_rooms), cells)
    assert len(missing) <= (1.0 - planner.config.goal) * len(planner.cells) + 1
    rooms = {int(x // 3.2) for stop in tour for x, y in [stop.point] if y > 0.9 or len(stop.cells) > 20}
    assert rooms == {0, 1, 2}


def test_rooms_are_visited_in_the_order_of_the_corridor():
    _, explorer = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    tour = explorer.building.planner.plan(
        np.ones(len(explorer.building.planner.cells), dtype=bool), (0.8, 0.8)
    )
    x = [stop.point[0] for stop in tour]
    assert x == sorted(x)


def test_what_was_seen_needs_no_stop_and_banned_places_are_not_used():
    _, explorer = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    planner = explorer.building.planner
    right = planner._centres[:, 0] > 6.4
    tour = planner.plan(right, (0.8, 0.8))
    assert tour
    assert all(planner._centres[stop.cells, 0].min() > 6.4 for stop in tour if len(stop.cells))
    assert planner.plan(np.zeros(len(planner.cells), dtype=bool), (0.8, 0.8)) == []
    banned = frozenset(stop.place for stop in tour)
    again = planner.plan(right, (0.8, 0.8), banned)
    assert again
    assert not banned & {stop.place for stop in again}


def test_an_open_room_within_range_needs_one_stop():
    plan = FloorPlan("room", shapely.box(0.0, 0.0, 4.0, 3.0))
    _, explorer = begin(plan, (0.5, 0.5, 0.0))
    tour = explorer.building.planner.plan(
        np.ones(len(explorer.building.planner.cells), dtype=bool), (0.5, 0.5)
    )
    assert len(tour) == 1


def test_the_oracle_sees_the_building_in_less_time_than_the_nearest_frontier():
    from slamgym.agents.registry import make_explorer

    plan, config = corridor_with_rooms(), TrialConfig(env=ENV)
    ours = run_trial(plan, 3, "oracle", config, Oracle.of)
    nearest = run_trial(
        plan, 3, "nearest", config, lambda env, seed: make_explorer("nearest", env.explorer_context(), seed)
    )
    assert ours.finished
    assert ours.coverage > 0.985
    assert ours.collisions == 0
    assert ours.time < nearest.time


def test_a_door_that_the_map_draws_too_narrow_is_squeezed_through_at_the_end():
    rooms = [shapely.box(0.0, 0.0, 5.0, 5.0), shapely.box(5.1, 0.0, 10.0, 5.0)]
    door = shapely.box(4.9, 2.02, 5.2, 2.49)  # the robot is 0.44 m wide, cells are of 0.05 m
    plan = FloorPlan("narrow", shapely.union_all([*rooms, door]))
    for shares, low, high in (((), 0.5, 0.9), ((0.85, 0.6), 0.98, 1.0)):
        make = partial(Oracle.of, config=OracleConfig(relaxed_footprints=shares))
        trial = run_trial(plan, 1, "oracle", TrialConfig(env=ENV), make)
        assert low <= trial.coverage <= high


def test_its_frame_is_the_robots_map_wherever_it_starts():
    plan = corridor_with_rooms()
    for start in ((0.8, 0.8, 0.0), (8.0, 3.0, math.pi / 2)):
        env, explorer = begin(plan, start)
        observation, *_ = env.step(np.zeros(2, np.float32))
        explorer.predict(observation)
        goal = explorer._navigator.goal
        assert plan.free_space.contains(shapely.Point(goal.x + start[0], goal.y + start[1]))


def test_another_episode_is_refused():
    _, explorer = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    with pytest.raises(RuntimeError, match="one episode"):
        explorer.reset()

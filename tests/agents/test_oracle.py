import numpy as np
import shapely

from slamgym.agents.evaluation.trial import TrialConfig, bound_trial, run_trial
from slamgym.agents.oracle import OracleConfig, TrueBuilding, bound_exploration
from slamgym.agents.tour_search import TourSearch
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


def entered(plan, start):
    env = ExploreEnv(plan, ENV)
    env.reset(seed=0, options={"plan": plan, "start": start})
    return env


def begin(plan, start):
    return TrueBuilding(entered(plan, start))


def test_the_tour_sees_what_was_asked_for_and_each_cell_belongs_to_one_stop():
    building = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    planner = building.planner
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
    building = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    tour = building.planner.plan(np.ones(len(building.planner.cells), dtype=bool), (0.8, 0.8))
    x = [stop.point[0] for stop in tour]
    assert x == sorted(x)


def test_what_was_seen_needs_no_stop_and_banned_places_are_not_used():
    building = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    planner = building.planner
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
    building = begin(plan, (0.5, 0.5, 0.0))
    tour = building.planner.plan(np.ones(len(building.planner.cells), dtype=bool), (0.5, 0.5))
    assert len(tour) == 1


QUICK = OracleConfig(iterations=30)


def test_more_of_the_floor_takes_longer_and_the_way_lies_between_simple_limits():
    bounds = bound_exploration(entered(corridor_with_rooms(), (0.8, 0.8, 0.0)), (0.95, 0.5, 0.99), 0, QUICK)
    assert [bound.share for bound in bounds] == [0.95, 0.5, 0.99]
    assert bounds[1].path < bounds[0].path <= bounds[2].path
    # The far room needs the corridor's length less the range of 3 m; entering two rooms on the way adds some metres.
    assert 4.0 < bounds[0].path < 16.0
    for bound in bounds:
        drive = bound.path / ENV.robot.max_linear
        assert drive < bound.time < drive + 20 * np.pi / ENV.robot.max_angular  # less than 20 stops


def test_a_tour_sees_what_it_claims_and_a_larger_budget_never_takes_longer():
    building = begin(corridor_with_rooms(), (0.8, 0.8, 0.0))
    lengths = []
    for iterations in (0, 40):
        search = TourSearch(building.planner, (0.8, 0.8), np.random.default_rng(3))
        tour = search.shortest(0.9, iterations)
        assert search.share(tour) >= 0.9 - 1e-3
        lengths.append(search.length(tour))
    assert lengths[1] <= lengths[0]


def test_the_bound_lies_below_an_explorer():
    from slamgym.agents.registry import make_explorer

    plan, config = corridor_with_rooms(), TrialConfig(env=ENV)
    bound = bound_trial(plan, 3, "", config, QUICK)
    nearest = run_trial(
        plan, 3, "nearest", config, lambda env, seed: make_explorer("nearest", env.explorer_context(), seed)
    )
    for level in ("0.9", "0.95", "0.99"):
        assert bound.time_to[level] < nearest.time_to[level]
        assert bound.path_to[level] < nearest.path_to[level]
    assert bound.time < nearest.time

import numpy as np
import shapely

from slamgym.agents.coverage_tour import TourSearch
from slamgym.agents.evaluation.trial import Task, TrialConfig, bound_trial, run_trial
from slamgym.agents.oracle import bound_exploration, true_viewpoints
from slamgym.cad import FloorPlan
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.slam import SlamConfig

ENV = ExploreConfig(slam=SlamConfig(mode="ground_truth")).for_explorer()


def corridor_with_rooms():
    """A corridor of 8 m with three rooms of 3 m to one side, each behind a door of 1 m."""
    parts = [shapely.box(0.0, 0.0, 9.4, 1.6)]
    for left in (0.0, 3.2, 6.4):
        parts += [
            shapely.box(left, 1.7, left + 3.0, 4.7),
            shapely.box(left + 1.0, 1.5, left + 2.0, 1.8),
        ]
    return FloorPlan("corridor", shapely.union_all(parts))


def entered(plan, start):
    env = ExploreEnv(plan, ENV)
    env.reset(seed=0, options={"plan": plan, "start": start})
    return env


def search(plan, start):
    """Viewpoints in a building, and a search for tours that see it."""
    viewpoints = true_viewpoints(entered(plan, start))
    wanted = np.ones(len(viewpoints.cells), dtype=bool)
    return viewpoints, TourSearch(viewpoints, start[:2], wanted, np.random.default_rng(3))


def test_a_tour_visits_all_rooms_in_the_order_of_the_corridor():
    viewpoints, tours = search(corridor_with_rooms(), (0.8, 0.8, 0.0))
    cells = len(viewpoints.cells)
    tour = tours.shortest(cells - 2, 20)
    assert np.count_nonzero(tours.counts(tour)) >= 0.99 * cells
    x = viewpoints.places[tour][:, 0]
    assert {int(value // 3.2) for value in x} == {0, 1, 2}
    assert (np.diff(x) > -1.0).all()  # never back to a room that was left


def test_paths_between_viewpoints_are_as_long_there_as_back():
    viewpoints, _ = search(corridor_with_rooms(), (0.8, 0.8, 0.0))
    np.testing.assert_array_equal(viewpoints.lengths, viewpoints.lengths.T)


def test_what_was_seen_needs_no_stop():
    start = (0.8, 0.8, 0.0)
    viewpoints, _ = search(corridor_with_rooms(), start)
    nothing = np.zeros(len(viewpoints.cells), dtype=bool)
    assert TourSearch(viewpoints, start[:2], nothing, np.random.default_rng(0)).shortest(9, 5) == []
    right = viewpoints._centres[:, 0] > 6.4
    tours = TourSearch(viewpoints, start[:2], right, np.random.default_rng(0))
    tour = tours.shortest(int(right.sum()), 5)
    assert tour
    assert viewpoints.places[tour][:, 0].min() > 3.2
    assert not tours.counts(tour)[~right].any()


def test_an_open_room_within_range_needs_one_stop():
    viewpoints, tours = search(FloorPlan("room", shapely.box(0.0, 0.0, 4.0, 3.0)), (0.5, 0.5, 0.0))
    assert len(tours.shortest(round(0.995 * len(viewpoints.cells)), 5)) == 1


def test_more_of_the_floor_takes_longer_and_the_way_lies_between_simple_limits():
    bounds = bound_exploration(
        entered(corridor_with_rooms(), (0.8, 0.8, 0.0)), (0.5, 0.95, 0.99), iterations=30
    )
    assert [bound.share for bound in bounds] == [0.5, 0.95, 0.99]
    assert bounds[0].path < bounds[1].path <= bounds[2].path
    # The far room needs the corridor's length less the range of 3 m; entering two rooms on the way adds some metres.
    assert 4.0 < bounds[1].path < 16.0
    for bound in bounds:
        drive = bound.path / ENV.robot.max_linear
        assert drive < bound.time < drive + 20 * np.pi / ENV.robot.max_angular  # less than 20 stops


def test_a_tour_sees_what_it_claims_and_a_larger_budget_never_takes_longer():
    viewpoints, tours = search(corridor_with_rooms(), (0.8, 0.8, 0.0))
    needed, lengths = round(0.9 * len(viewpoints.cells)), []
    for iterations in (0, 40):
        tour = tours.shortest(needed, iterations)
        assert np.count_nonzero(tours.counts(tour)) >= needed
        lengths.append(tours.length(tour))
    assert lengths[1] <= lengths[0]


def test_the_bound_lies_below_an_explorer():
    config, plan = TrialConfig(env=ENV), corridor_with_rooms()
    bound = bound_trial(Task("oracle", plan, 3), config)
    nearest = run_trial(Task("nearest", plan, 3), config)
    for level in ("0.9", "0.95", "0.99"):
        assert bound.time_to[level] < nearest.time_to[level]
        assert bound.path_to[level] < nearest.path_to[level]
    assert bound.time < nearest.time

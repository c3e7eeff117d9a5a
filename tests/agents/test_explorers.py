import dataclasses

import numpy as np
import pytest
import shapely

from slamgym.agents import EXPLORERS, make_explorer
from slamgym.agents.explorer import FrontierExplorer
from slamgym.agents.registry import CLASSICAL
from slamgym.agents.rules import EXPLORE_LITE_LOOP, ExploreLite
from slamgym.agents.simulated_operator import SimulatedOperator
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Pose2D, Twist2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.planning import find_frontiers, make_costmap

FRONTIER_EXPLORERS = list(CLASSICAL)


def closed(rows, cols):
    cells = np.full((rows, cols), FREE)
    cells[[0, -1]] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    return cells


def two_rooms(door_cells):
    cells = closed(70, 130)
    cells[:, 63:66] = OCCUPIED
    cells[40 : 40 + door_cells, 63:66] = FREE
    return cells


def explore(world, explorer, seconds):
    """Run until the explorer has finished; returns the time and the actions."""
    actions, published = [], None
    for step in range(int(seconds / world.context.control_step)):
        time = step * world.context.control_step
        observation = world.observation(time)
        if step % 10 == 0:
            published = observation["map"]
            published.flags.writeable = False
        observation["map"] = published
        action, _ = explorer.predict(observation)
        actions.append(action)
        if explorer.finished:
            return time, np.array(actions)
        world.drive(world_velocity(world, action))
    return seconds, np.array(actions)


def world_velocity(world, action):

    return Twist2D(
        float(action[0]) * world.context.max_linear, float(action[1]) * world.context.max_angular
    )


def share_seen(world, where):
    return (world.map[where] != UNKNOWN)[world.truth.cells[where] == FREE].mean()


@pytest.mark.parametrize("name", FRONTIER_EXPLORERS)
def test_two_rooms_with_a_door_of_70_cm_are_explored_to_the_end(make_world, name):
    world = make_world(two_rooms(door_cells=14))
    world.place(12, 15, 2.0)
    explorer = make_explorer(name, world.context)
    time, actions = explore(world, explorer, 240.0)
    assert explorer.finished
    assert share_seen(world, np.s_[:, :]) > 0.97
    assert world.contacts == 0
    assert np.abs(actions).max() <= 1.0
    assert np.all(explorer.predict(world.observation(time + 0.2))[0] == 0.0)


def test_explore_lite_continues_through_an_inflated_doorway(make_world):
    world = make_world(two_rooms(door_cells=14))
    world.map[:, :64] = world.truth.cells[:, :64]
    world.map[38:56, 63:80] = world.truth.cells[
        38:56, 63:80
    ]  # the doorway and a bit beyond are known
    world.place(20, 20)
    explorer = make_explorer("explore_lite", world.context)
    explore(world, explorer, 180.0)
    assert explorer.finished
    assert share_seen(world, np.s_[:, 66:]) > 0.95


@pytest.mark.parametrize("name", FRONTIER_EXPLORERS)
def test_frontiers_behind_a_gap_that_the_robot_cannot_pass_end_the_exploration(make_world, name):
    world = make_world(two_rooms(door_cells=4))
    world.place(20, 20)
    explorer = make_explorer(name, world.context)
    time, _ = explore(world, explorer, 240.0)
    assert explorer.finished
    assert share_seen(world, np.s_[:, :63]) > 0.97
    assert time < 150.0


@pytest.mark.parametrize("name", ["nearest", "cost_utility"])
def test_an_exploration_between_panes_of_glass_ends(make_world, name):
    cells = closed(150, 200)
    cells[20:140:23, 10:190:17] = OCCUPIED  # posts in the garden
    cells[50:101, 60:131] = OCCUPIED
    cells[51:100, 61:130] = FREE
    world = make_world(cells)
    world.glass[60:70, 60] = world.glass[70:94, 130] = True
    world.place(75, 90, 2.0)
    explorer = make_explorer(name, world.context)
    explore(world, explorer, 400.0)  # a way round a pane that gets shorter is progress
    assert explorer.finished
    assert share_seen(world, np.s_[51:100, 61:130]) > 0.97


@pytest.mark.parametrize("name", ["explore_lite", "next_best_view"])  # it is the loop that copes
def test_a_room_larger_than_the_range_is_explored_from_its_middle(make_world, name):
    # From the middle everything known is a disc: its frontier's centroid is where the robot stands.
    world = make_world(closed(220, 220))
    world.place(110, 110)
    for theta in np.linspace(0.0, 6.0, 7):
        world.pose = Pose2D(world.pose.x, world.pose.y, theta)
        world.scan()
    (frontier,) = find_frontiers(
        make_costmap(OccupancyGrid(world.map, world.truth.frame)), world.pose
    )
    assert np.hypot(frontier.centroid[0] - world.pose.x, frontier.centroid[1] - world.pose.y) < 0.5
    explorer = make_explorer(name, world.context)
    explore(world, explorer, 500.0)
    assert explorer.finished
    assert share_seen(world, np.s_[:, :]) > 0.97


def test_a_robot_that_can_go_nowhere_finishes_soon(make_world):
    cells = closed(60, 60)
    cells[20:40, 20:40] = OCCUPIED
    cells[25:35, 25:35] = FREE
    world = make_world(cells)
    world.place(30, 30)
    explorer = make_explorer("explore_lite", world.context)
    time, _ = explore(world, explorer, 120.0)
    assert explorer.finished
    assert time < 60.0


def test_the_original_minimum_size_is_a_setting(make_world):
    world = make_world(two_rooms(door_cells=14))
    settings = dataclasses.replace(EXPLORE_LITE_LOOP, min_frontier_size=100.0)
    explorer = FrontierExplorer(world.context, ExploreLite(), settings)
    world.place(20, 20)
    time, _ = explore(world, explorer, 240.0)
    # Larger frontiers come first; at the end those down to the last size are visited all the same.
    assert explorer.finished
    assert share_seen(world, np.s_[:, :]) > 0.9
    assert time > 0


@pytest.mark.parametrize("name", list(EXPLORERS))
def test_a_batch_acts_as_its_members_alone(make_world, name):
    def begin():
        worlds = [make_world(two_rooms(14)), make_world(two_rooms(14))]
        worlds[0].place(12, 15, 2.0)
        worlds[1].place(50, 100, -1.0)
        return worlds

    worlds, together = begin(), make_explorer(name, make_world(two_rooms(14)).context, seed=3)
    recorded, actions = [], []
    for step in range(60):
        observations = [world.observation(0.2 * step) for world in worlds]
        batch = {key: np.stack([o[key] for o in observations]) for key in observations[0]}
        starts = np.full(2, step == 0)
        action, state = together.predict(
            batch, state=None, episode_start=starts, deterministic=True
        )
        assert action.shape == (2, 2)
        assert action.dtype == np.float32
        assert state is None
        recorded.append(observations)
        actions.append(action)
        for world, one in zip(worlds, action, strict=True):
            world.drive(world_velocity(world, one))
    if name in ("random", "simulated_operator"):
        assert not np.array_equal(np.array(actions)[:, 0], np.array(actions)[:, 1])
        return  # each member of a batch has a random stream of its own
    for member in range(2):
        alone = make_explorer(name, together.context, seed=3)
        singly = [alone.predict(observations[member])[0] for observations in recorded]
        np.testing.assert_array_equal(np.array(singly), np.array(actions)[:, member])


def test_a_new_episode_forgets_the_last_one(make_world):
    world = make_world(closed(60, 60))
    world.place(30, 30)
    explorer = make_explorer("nearest", world.context)
    explore(world, explorer, 120.0)
    assert explorer.finished
    fresh = make_world(closed(60, 60))
    fresh.place(30, 30)
    first = fresh.observation(0.0)
    action, _ = explorer.predict(first, episode_start=np.array([True]))
    assert not explorer.finished
    np.testing.assert_array_equal(action, make_explorer("nearest", world.context).predict(first)[0])
    # A clock that runs backwards says the same.
    explorer.predict(fresh.observation(50.0))
    again, _ = explorer.predict(first)
    np.testing.assert_array_equal(action, again)


def test_only_the_finished_members_of_a_batch_stand_still(make_world):
    small, large = make_world(closed(60, 130)), make_world(closed(60, 130))
    small.truth.cells[:, 60] = OCCUPIED
    small.place(30, 30)
    large.place(30, 30)
    explorer = make_explorer("explore_lite", large.context)
    for step in range(600):
        observations = [world.observation(0.2 * step) for world in (small, large)]
        batch = {key: np.stack([o[key] for o in observations]) for key in observations[0]}
        action, _ = explorer.predict(batch)
        finished = np.array([pilot.finished for pilot in explorer._pilots])
        assert np.all(action[finished] == 0.0)
        assert explorer.finished == finished.all()
        if explorer.finished:
            break
        for world, one in zip((small, large), action, strict=True):
            world.drive(world_velocity(world, one))
    assert explorer.finished


def test_a_random_walk_is_seeded_and_never_finishes(make_world):
    def walk(seed):
        world = make_world(closed(60, 80))
        world.place(30, 30)
        return explore(world, make_explorer("random", world.context, seed), 40.0), world

    (time, actions), world = walk(1)
    assert time == 40.0
    assert world.contacts == 0
    np.testing.assert_array_equal(actions, walk(1)[0][1])
    assert not np.array_equal(actions, walk(2)[0][1])


def test_an_unknown_explorer_is_refused_with_the_nearest_name(make_world):
    context = make_world(closed(20, 20)).context
    with pytest.raises(ConfigError, match="explore_lite"):
        make_explorer("explore-lite", context)


def by_keyboard(make_world, seed):
    world = make_world(two_rooms(door_cells=18))
    world.place(12, 15, 2.0)
    explorer = SimulatedOperator(world.context, seed)
    time, actions = explore(world, explorer, 900.0)
    return world, explorer, time, actions * (world.context.max_linear, world.context.max_angular)


def test_a_driver_sees_both_rooms_and_mostly_goes_straight_or_turns_on_the_spot(make_world):
    world, explorer, _, actions = by_keyboard(make_world, 1)
    assert explorer.finished
    assert share_seen(world, np.s_[:, :]) > 0.97
    linear, angular = np.abs(actions).T
    assert linear.max() <= 0.26 + 1e-6
    assert angular.max() <= 1.2 + 1e-6
    moving = linear + angular > 0.0
    assert np.mean((linear[moving] == 0.0) | (angular[moving] == 0.0)) > 0.5
    assert not ((linear > 0.0) & (angular > 0.0) & (angular < 0.05)).any()


def test_visits_lengthen_the_drive_and_drivers_differ(make_world, monkeypatch):
    drives = []
    for seed, visits in ((4, 0), (4, 3), (2, 0)):
        monkeypatch.setattr("slamgym.agents.simulated_operator._VISITS", (visits, visits))
        drives.append(by_keyboard(make_world, seed)[2:])
    (short, first), (long, again), (_, other) = drives
    assert long > short + 5.0
    np.testing.assert_array_equal(
        first[:-1], again[: len(first) - 1]
    )  # the same seed drives the same
    assert np.abs(first[:, 0]).max() != pytest.approx(np.abs(other[:, 0]).max(), abs=1e-3)


def test_a_promise_stands_behind_the_name_or_beside_it(make_world):
    from slamgym.planning.promise import Promise

    context = make_world(two_rooms(14)).context
    named = make_explorer("nearest@98%:90%", context)
    assert named.config.promise == Promise(0.98, None, 0.9)
    beside = make_explorer("nearest", context, 0, Promise(0.98, None, 0.9))
    assert beside.fingerprint == named.fingerprint != make_explorer("nearest", context).fingerprint
    assert make_explorer("rl@2m2", context).config.promise == Promise(None, 2.0)
    assert make_explorer("explore_lite", context, 0, Promise()).config.promise is None
    with pytest.raises(ConfigError, match="ends as its source does"):
        make_explorer("explore_lite@98%", context)


def rooms_parted_by_posts(gap):
    """Two rooms of 3 x 3 m, and between them posts of 10 cm with gaps of some width [m]."""
    rooms = [shapely.box(0.0, 0.0, 3.0, 3.0), shapely.box(3.1, 0.0, 6.1, 3.0)]
    below = np.arange(0.2, 2.9 - gap, gap + 0.1).tolist()
    gaps = [shapely.box(2.95, y, 3.15, y + gap) for y in below]
    return FloorPlan("posts", shapely.union_all([*rooms, *gaps]))


@pytest.mark.parametrize(("gap", "most"), [(0.30, 2), (0.34, 0)])
def test_gaps_as_wide_as_the_robot_are_not_squeezed_into(gap, most):
    """A robot 0.30 m wide, whom noise tells that it fits, touches posts twice at most; gaps of 0.34 m it passes."""
    for seed in range(3):
        env = ExploreEnv(
            rooms_parted_by_posts(gap),
            ExploreConfig().for_explorer(),
            robot={"radius": 0.15},
            localization="ground_truth",
            time_limit=300.0,
        )
        observation, info = env.reset(seed=seed)
        explorer = make_explorer("tour", env.explorer_context(), seed)
        while not explorer.finished:
            action, _ = explorer.predict(observation)
            observation, _, _, truncated, info = env.step(action)
            assert not truncated
        assert info["collisions"] <= most
        assert info["coverage"] > 0.97

import math

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import (
    Clutter,
    ClutterConfig,
    Crowd,
    Lidar,
    RobotConfig,
    World,
    lidar_level,
    make_clutter,
    sample_start,
)
from slamgym.sim.clutter import fitting_area, largest_part
from slamgym.sim.furniture import pieces_for
from slamgym.sim.people import PERSON_RADIUS, SEGMENTS_PER_PERSON

FURNISHED = ClutterConfig(furniture=1.0)


def furnish(plan, seed, **settings):
    return make_clutter(plan, np.random.default_rng(seed), ClutterConfig(**({"furniture": 1.0} | settings)))


class TestFurniture:
    @pytest.mark.parametrize("seed", range(5))
    def test_it_stands_in_the_free_space_and_apart(self, flat, seed):
        clutter = furnish(flat, seed)
        assert len(clutter.outlines) >= 4
        assert all(flat.free_space.contains(piece) for piece in (*clutter.outlines, *clutter.furniture))
        for index, piece in enumerate(clutter.outlines):
            assert all(piece.disjoint(other) for other in clutter.outlines[:index])

    @pytest.mark.parametrize("seed", range(5))
    @pytest.mark.parametrize("shape", ["circle", "footprint"])
    def test_it_leaves_every_way_in_one_piece_and_wide_enough(self, flat, seed, shape):
        robot = RobotConfig(shape=shape)
        clutter = make_clutter(flat, np.random.default_rng(seed), FURNISHED, robot)
        for radius in (robot.circumscribed_radius, robot.circumscribed_radius + FURNISHED.passage):
            empty = fitting_area(flat, radius)
            assert len(shapely.get_parts(empty)) == 1
            ways = fitting_area(flat, radius, clutter.outlines)
            assert len(shapely.get_parts(ways)) == 1
            # No room is given up: what isn't passable any more is under or beside the furniture.
            beside = shapely.union_all([piece.buffer(radius + 1e-3) for piece in clutter.outlines])
            assert empty.difference(beside).within(ways.buffer(1e-6))

    def test_doors_stay_free(self, flat):
        for seed in range(5):
            for piece in furnish(flat, seed).outlines:
                for door in flat.doors:
                    assert piece.distance(shapely.LineString([door.start, door.end])) >= 0.44

    def test_walled_pieces_stand_with_their_back_to_a_wall(self, flat):
        for seed in range(3):
            near = [
                piece.distance(flat.free_space.exterior) < 0.051 for piece in furnish(flat, seed).outlines
            ]
            # Tables in kitchens and living rooms stand free; every flat has at most three of them.
            assert sum(near) >= len(near) - 3

    def test_the_same_generator_furnishes_alike_and_another_one_otherwise(self, flat):
        assert furnish(flat, 1).furniture == furnish(flat, 1).furniture
        assert furnish(flat, 1).furniture != furnish(flat, 2).furniture

    def test_the_share_rules_how_much_there_is(self, flat):
        counts = [
            sum(len(furnish(flat, seed, furniture=share).outlines) for seed in range(8))
            for share in (0.0, 0.4, 1.0)
        ]
        assert counts[0] == 0
        assert 0.2 * counts[2] < counts[1] < 0.7 * counts[2]

    def test_a_plan_without_rooms_stays_empty(self, hall):
        assert furnish(hall, 0) == Clutter()

    def test_a_turned_building_is_furnished_along_its_walls(self, flat):
        def turn(shape):
            return shapely.affinity.rotate(shape, 30.0, origin=(0, 0))

        rooms = tuple(type(room)(room.category, turn(room.polygon)) for room in flat.rooms)
        clutter = furnish(FloorPlan("turned", turn(flat.free_space), rooms), 0)
        assert clutter.outlines
        for piece in clutter.furniture:
            edge = np.diff(np.asarray(piece.exterior.coords)[:2], axis=0)[0]
            assert math.degrees(math.atan2(edge[1], edge[0])) % 90.0 == pytest.approx(30.0, abs=1e-6)

    def test_the_category_decides_what_stands_in_a_room(self):
        assert pieces_for("Bedroom") == pieces_for("Child_Room") != pieces_for("Kitchen")
        assert pieces_for("Room") == pieces_for("")

    def test_the_lidar_sees_it_and_the_drawing_does_not(self, flat):
        clutter = furnish(flat, 0)
        world, empty = World(flat, RobotConfig(), clutter=clutter), World(flat, RobotConfig())
        lidar = Lidar(lidar_level("exact"))
        start = sample_start(flat, RobotConfig(), np.random.default_rng(0), clutter)
        ranges = np.array(
            [
                [
                    lidar.true_ranges(Pose2D(start.x, start.y, angle), w.segments())
                    for angle in np.linspace(-3, 3, 5)
                ]
                for w in (world, empty)
            ]
        )
        assert (ranges[0] <= ranges[1]).all()
        assert (ranges[0] < ranges[1]).any()
        assert len(empty.segments()) == len(flat.segments())

    def test_it_is_an_obstacle(self, hall):
        box = shapely.box(4.0, 2.0, 5.0, 4.0)
        world = World(hall, RobotConfig(), clutter=Clutter(furniture=(box,)))
        world.reset(Pose2D(3.0, 3.0, 0.0))
        motions = [world.step(Twist2D(0.26, 0.0), 0.2) for _ in range(40)]
        assert motions[-1].contact
        assert world.pose.x <= 4.0 - 0.22


class TestPeople:
    def test_they_walk_in_the_free_space_and_get_about(self, flat):
        clutter = furnish(flat, 0, people=3)
        crowd = Crowd(clutter.people, clutter.walkable)
        obstacles = shapely.union_all(clutter.outlines)
        track = []
        for _ in range(600):
            crowd.advance(0.2, -100.0, -100.0, 0.22)
            track.append(crowd.discs[:, :2].copy())
        track = np.array(track)
        bodies = shapely.points(track.reshape(-1, 2))
        assert shapely.distance(bodies, flat.free_space.exterior).min() >= PERSON_RADIUS
        assert shapely.distance(bodies, obstacles).min() >= PERSON_RADIUS * 0.98  # drawn with chords
        assert (np.ptp(track, axis=0) > 1.0).any(axis=1).all()

    def test_they_keep_to_their_speed(self, flat):
        clutter = furnish(flat, 0, furniture=0.0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        for _ in range(300):
            before = crowd.discs[:, :2].copy()
            crowd.advance(0.1, -100.0, -100.0, 0.22)
            moved = np.hypot(*(crowd.discs[:, :2] - before).T)
            assert (moved <= [person.speed * 0.1 + 1e-9 for person in clutter.people]).all()

    def test_they_stop_for_the_robot_wherever_it_is(self, flat):
        clutter = furnish(flat, 3, people=4)
        robot = RobotConfig()
        world = World(flat, robot, clutter=clutter)
        world.reset(sample_start(flat, robot, np.random.default_rng(0), clutter))
        rng = np.random.default_rng(1)
        seen = world.segments()
        for _ in range(1500):
            # The robot may run into people, but neither ever overlaps the other.
            pose = world.step(Twist2D(0.26, rng.uniform(-1.5, 1.5)), 0.2).pose
            legs = seen[-4 * SEGMENTS_PER_PERSON :].reshape(-1, 2)
            assert np.hypot(*(legs - pose[:2]).T).min() > robot.radius

    def test_their_legs_stay_within_their_disc(self, flat):
        clutter = furnish(flat, 0, furniture=0.0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        for _ in range(100):
            crowd.advance(0.1, -100.0, -100.0, 0.22)
            ends = crowd.legs().reshape(2, -1, 2)
            assert np.hypot(*np.moveaxis(ends - crowd.discs[:, None, :2], -1, 0)).max() <= PERSON_RADIUS

    def test_a_reset_lets_them_walk_the_same_ways_again(self, flat):
        clutter = furnish(flat, 0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        walks = []
        for _ in range(2):
            crowd.reset()
            for _ in range(200):
                crowd.advance(0.2, 1.0, 1.0, 0.22)
            walks.append(crowd.discs.copy())
        assert np.array_equal(*walks)

    def test_nobody_is_where_nobody_fits(self):
        plan = FloorPlan("slot", shapely.box(0, 0, 0.5, 4))
        clutter = make_clutter(plan, np.random.default_rng(0), ClutterConfig(people=2))
        assert clutter.people == ()


def test_the_largest_part_of_nothing_is_empty():
    assert largest_part(shapely.Polygon()).is_empty

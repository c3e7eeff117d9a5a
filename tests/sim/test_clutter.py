import math

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.cad.polygons import largest_part
from slamgym.core.errors import ConfigError
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
from slamgym.sim.clutter import outlines_of
from slamgym.sim.furniture import pieces_for
from slamgym.sim.passages import PASSAGE_CELL, Passages
from slamgym.sim.people import PERSON_RADIUS

NOBODY = np.empty((0, 3))
FURNISHED = ClutterConfig(furniture=1.0)
EVERYTHING = {"furniture": 1.0, "doors": 1.0, "changes": 6.0}


def furnish(plan, seed, **settings):
    return make_clutter(
        plan, np.random.default_rng(seed), ClutterConfig(**({"furniture": 1.0} | settings))
    )


def polygons(clutter):
    """The pieces' outlines, places of doors' leaves among them."""
    along = clutter.outlines[:, 2:4] * clutter.outlines[:, 4:5]
    across = clutter.outlines[:, [3, 2]] * [-1.0, 1.0] * clutter.outlines[:, 5:6]
    corners = np.stack([-along - across, along - across, along + across, across - along], axis=1)
    return list(shapely.polygons(clutter.outlines[:, None, :2] + corners))


def all_solids(clutter):
    """Everything in all its places."""
    moved = [solid for places in clutter.movables for place in places for solid in place]
    return [shapely.Polygon(solid) for solid in (*clutter.furniture, *moved)]


class TestFurniture:
    @pytest.mark.parametrize("seed", range(5))
    def test_it_stands_in_the_free_space_and_apart(self, flat, seed):
        clutter = furnish(flat, seed)
        pieces = polygons(clutter)
        assert len(pieces) >= 10
        assert all(flat.free_space.contains(piece) for piece in (*pieces, *all_solids(clutter)))
        for index, piece in enumerate(pieces):
            assert all(piece.disjoint(other) for other in pieces[:index])

    @pytest.mark.parametrize("seed", range(3))
    def test_what_stands_on_the_floor_is_within_the_pieces(self, flat, seed):
        clutter = furnish(flat, seed, **EVERYTHING)
        covered = shapely.union_all(polygons(clutter)).buffer(1e-6)
        assert all(covered.covers(solid) for solid in all_solids(clutter))

    @pytest.mark.parametrize("seed", range(5))
    def test_it_leaves_every_way_in_one_piece_and_wide_enough(self, flat, seed):
        robot = RobotConfig()
        clutter = make_clutter(flat, np.random.default_rng(seed), FURNISHED, robot)
        for radius in (robot.radius, robot.radius + 0.1):
            grown = shapely.union_all([piece.buffer(radius) for piece in polygons(clutter)])
            ways = flat.free_space.buffer(-radius).difference(grown)
            # Pockets smaller than a few cells hold no cell's centre.
            assert sum(part.area > 8 * PASSAGE_CELL**2 for part in shapely.get_parts(ways)) == 1
            for room in flat.rooms:
                assert largest_part(ways).intersects(room.polygon)

    def test_a_crowded_flat_has_more_and_is_still_passable(self, flat):
        usual, crowded = (
            [furnish(flat, seed, furniture=share) for seed in range(4)] for share in (1.0, 2.0)
        )

        def covered(clutters):
            return sum(shapely.Polygon(solid).area for c in clutters for solid in c.furniture)

        assert covered(crowded) > 1.3 * covered(usual)
        radius = RobotConfig().radius
        assert all(clutter.passages.parts(radius)[1].max() == 1 for clutter in crowded)

    def test_an_untidy_room_has_small_things_and_chairs_at_any_angle(self, flat):
        tidy, untidy = (
            [furnish(flat, seed, untidiness=u) for seed in range(5)] for u in (0.0, 1.0)
        )

        def small(clutters):
            return sum(
                np.ptp(solid, axis=0).max() < 0.35 for c in clutters for solid in c.furniture
            )

        def angles(clutters):
            chairs = [places[0] for c in clutters for places in c.movables if len(places[0]) == 4]
            sides = np.array([legs[1].mean(axis=0) - legs[0].mean(axis=0) for legs in chairs])
            return abs(np.sin(2.0 * np.arctan2(sides[:, 1], sides[:, 0])))

        assert small(untidy) > small(tidy) + 50
        assert angles(tidy).max() < math.sin(0.42)
        assert angles(untidy).max() > 0.8

    def test_a_door_ajar_lets_a_beam_through_but_no_robot(self, flat):
        closed, ajar = (
            furnish(
                flat, 0, furniture=0.0, doors=1.0, closed_doors=1.0, ajar_doors=share, cut_off=True
            )
            for share in (0.0, 1.0)
        )
        assert len(ajar.movables) == len(closed.movables) > 1
        assert ajar.cut_off == closed.cut_off != ()
        turns = [
            np.ptp(solid, axis=0).min()
            for clutter in (closed, ajar)
            for (solid,), *_ in clutter.movables
        ]
        count = len(closed.movables)
        # A leaf is 4 cm thick; 3 degrees turn one of 0.6 m by 3 cm.
        assert max(turns[:count]) < 0.041
        assert min(turns[count:]) > 0.06

    @pytest.mark.parametrize("seed", range(4))
    def test_no_place_of_doors_and_chairs_cuts_a_room_off(self, flat, seed):
        robot = RobotConfig()
        clutter = furnish(flat, seed, **EVERYTHING)
        assert clutter.cut_off == ()
        grown = [piece.buffer(robot.radius) for piece in polygons(clutter)]
        ways = largest_part(
            flat.free_space.buffer(-robot.radius).difference(shapely.union_all(grown))
        )
        assert all(ways.intersects(room.polygon) for room in flat.rooms)

    def test_doors_stay_free(self, flat):
        for seed in range(5):
            for piece in polygons(furnish(flat, seed)):
                for door in flat.doors:
                    assert piece.distance(shapely.LineString([door.start, door.end])) >= 0.44

    def test_most_of_it_hugs_walls(self, flat):
        for seed in range(3):
            gaps = [
                piece.distance(flat.free_space.exterior) for piece in polygons(furnish(flat, seed))
            ]
            assert np.mean(np.array(gaps) < 0.1) > 0.6

    def test_the_same_generator_furnishes_alike_and_another_one_otherwise(self, flat):
        one, same, other = (furnish(flat, seed, **EVERYTHING).segments() for seed in (1, 1, 2))
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)

    def test_the_share_rules_how_much_there_is(self, flat):
        counts = [
            sum(len(furnish(flat, seed, furniture=share).outlines) for seed in range(8))
            for share in (0.0, 0.4, 1.0)
        ]
        assert counts[0] == 0
        assert 0.2 * counts[2] < counts[1] < 0.7 * counts[2]

    def test_where_there_is_no_way_through_less_is_placed_and_the_rest_counted(self):
        space = shapely.box(0, 0, 8, 1.1)
        plan = FloorPlan("corridor", space, (Room("Bedroom", space),))
        assert sum(furnish(plan, seed).left_out for seed in range(3)) >= 3
        for seed in range(3):
            clutter = furnish(plan, seed)
            radius = RobotConfig().radius
            grown = shapely.union_all([piece.buffer(radius) for piece in polygons(clutter)])
            ways = largest_part(space.buffer(-radius).difference(grown))
            assert ways.bounds[2] - ways.bounds[0] > 4.0

    def test_rooms_are_guessed_where_a_plan_names_none(self, flat, hall):
        assert len(furnish(hall, 0).outlines) >= 3
        without_names = FloorPlan("nameless", flat.free_space)
        pieces = polygons(furnish(without_names, 0))
        assert (
            sum(any(room.polygon.contains(piece) for piece in pieces) for room in flat.rooms) >= 3
        )

    def test_a_turned_building_is_furnished_along_its_walls(self, flat):
        def turn(shape):
            return shapely.affinity.rotate(shape, 30.0, origin=(0, 0))

        rooms = tuple(type(room)(room.category, turn(room.polygon)) for room in flat.rooms)
        clutter = furnish(FloorPlan("turned", turn(flat.free_space), rooms), 0)
        angles = np.degrees(np.arctan2(clutter.outlines[:, 3], clutter.outlines[:, 2])) % 90.0
        # Chairs, boxes and toys lie about at other angles.
        assert np.mean(np.isclose(angles, 30.0)) > 0.6

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
        box = np.array([(4.0, 2.0), (5.0, 2.0), (5.0, 4.0), (4.0, 4.0)])
        world = World(hall, RobotConfig(), clutter=Clutter(furniture=(box,)))
        world.reset(Pose2D(3.0, 3.0, 0.0))
        motions = [world.step(Twist2D(0.26, 0.0), 0.2) for _ in range(40)]
        assert motions[-1].contact
        assert world.pose.x <= 4.0 - 0.22

    def test_a_leg_has_the_shadow_of_its_square_in_every_direction(self):
        square = np.array([(0.0, 0.0), (0.04, 0.0), (0.04, 0.04), (0.0, 0.04)])
        seen = outlines_of([square])
        assert len(seen) == 2
        for angle in np.linspace(0.0, math.pi, 7):
            across = np.array([-math.sin(angle), math.cos(angle)])
            assert np.ptp(seen.reshape(-1, 2) @ across) == pytest.approx(np.ptp(square @ across))


class TestSettings:
    def test_a_density_beyond_all_is_refused(self):
        with pytest.raises(ConfigError, match=r"clutter.furniture must be in \[0, 3\], not 3.5"):
            ClutterConfig(furniture=3.5)


class TestDoors:
    def test_leaves_hang_in_the_doors(self, flat):
        for seed in range(3):
            leaves = furnish(flat, seed, furniture=0.0, doors=1.0, closed_doors=0.0).movables
            assert len(leaves) == len(flat.doors)
            for places, door in zip(leaves, flat.doors, strict=True):
                opening = shapely.LineString([door.start, door.end])
                leaf = shapely.Polygon(places[0][0])
                assert leaf.distance(shapely.MultiPoint([door.start, door.end])) < 0.05
                assert flat.free_space.contains(leaf)
                assert opening.difference(leaf.buffer(0.05)).length > 0.44

    def test_closed_doors_cut_off_only_what_they_may(self, flat):
        for seed in range(4):
            # In a row of rooms each door is needed.
            assert furnish(flat, seed, furniture=0.0, doors=1.0, closed_doors=1.0).movables == ()
            shut = furnish(flat, seed, furniture=0.0, doors=1.0, closed_doors=1.0, cut_off=True)
            assert len(shut.cut_off) == 2
            assert set(shut.cut_off) < {room.category for room in flat.rooms}

    def test_things_move_while_the_robot_drives_and_a_reset_puts_them_back(self, flat):
        clutter = furnish(flat, 0, **EVERYTHING | {"changes": 60.0})
        robot = RobotConfig()
        world = World(flat, robot, clutter=clutter)
        start = sample_start(flat, robot, np.random.default_rng(0), clutter)
        runs = []
        for _ in range(2):
            world.reset(start)
            first = world.segments().copy()
            for _ in range(300):
                pose = world.step(Twist2D(0.1, 0.8), 0.2).pose
                assert (
                    shapely.Point(pose.x, pose.y).distance(
                        shapely.MultiLineString(list(world.segments().reshape(-1, 2, 2)))
                    )
                    > robot.radius - 1e-6
                )
            runs.append((first, world.segments().copy()))
        assert not np.array_equal(*runs[0])
        assert np.array_equal(runs[0][0], runs[1][0])
        assert np.array_equal(runs[0][1], runs[1][1])
        assert len(world.building.furniture()) == len(clutter.solids())


class TestPassages:
    def test_distances_are_exact(self, flat):
        passages = Passages(flat, 0.5)
        rng = np.random.default_rng(0)
        rows, cols = np.nonzero(passages.clearance > 0.0)
        for index in rng.integers(len(rows), size=50):
            x, y = (
                np.array(passages.origin)
                + (np.array([cols[index], rows[index]]) + 0.5) * PASSAGE_CELL
            )
            true = min(0.5, flat.free_space.exterior.distance(shapely.Point(x, y)))
            assert passages.clearance[rows[index], cols[index]] == pytest.approx(true)

    def test_a_box_that_would_cut_a_room_in_two_is_refused(self, hall):
        radii = np.array([0.22])
        across = np.array([[4.0, 3.0, 0.0, 1.0, 2.9, 0.1]])
        beside = np.array([[4.0, 3.0, 0.0, 1.0, 2.5, 0.1]])
        assert Passages(hall, 0.5).first_fit(across, radii) == -1
        assert Passages(hall, 0.5).first_fit(beside, radii) == 0


class TestPeople:
    def test_they_walk_in_the_free_space_and_get_about(self, flat):
        clutter = furnish(flat, 0, people=3)
        crowd = Crowd(clutter.people, clutter.walkable)
        obstacles = shapely.union_all(polygons(clutter))
        track = []
        for _ in range(600):
            crowd.advance(0.2, NOBODY)
            track.append(crowd.discs[:, :2].copy())
        track = np.array(track)
        bodies = shapely.points(track.reshape(-1, 2))
        assert shapely.distance(bodies, flat.free_space.exterior).min() >= PERSON_RADIUS
        assert shapely.distance(bodies, obstacles).min() >= PERSON_RADIUS
        assert (np.ptp(track, axis=0) > 1.0).any(axis=1).all()

    def test_they_keep_to_their_speed(self, flat):
        clutter = furnish(flat, 0, furniture=0.0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        for _ in range(300):
            before = crowd.discs[:, :2].copy()
            crowd.advance(0.1, NOBODY)
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
            legs = seen[-4 * 12 :].reshape(-1, 2)
            assert np.hypot(*(legs - pose[:2]).T).min() > robot.radius

    def test_their_legs_stay_within_their_disc(self, flat):
        clutter = furnish(flat, 0, furniture=0.0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        for _ in range(100):
            crowd.advance(0.1, NOBODY)
            ends = crowd.legs().reshape(2, -1, 2)
            assert (
                np.hypot(*np.moveaxis(ends - crowd.discs[:, None, :2], -1, 0)).max()
                <= PERSON_RADIUS
            )

    def test_a_reset_lets_them_walk_the_same_ways_again(self, flat):
        clutter = furnish(flat, 0, people=2)
        crowd = Crowd(clutter.people, clutter.walkable)
        walks = []
        for _ in range(2):
            crowd.reset()
            for _ in range(200):
                crowd.advance(0.2, np.array([[1.0, 1.0, 0.22]]))
            walks.append(crowd.discs.copy())
        assert np.array_equal(*walks)

    def test_nobody_is_where_nobody_fits(self):
        plan = FloorPlan("slot", shapely.box(0, 0, 0.5, 4))
        clutter = make_clutter(plan, np.random.default_rng(0), ClutterConfig(people=2))
        assert clutter.people == ()


def test_the_largest_part_of_nothing_is_empty():
    assert largest_part(shapely.Polygon()).is_empty

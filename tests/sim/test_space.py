import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.geometry import compose
from slamgym.core.types import Pose2D, Twist2D
from slamgym.sim import Clutter, Person, RobotConfig, World, sample_start
from slamgym.sim.contact import SKIN
from slamgym.sim.people import Walkable

AHEAD = Twist2D(0.26, 0.0)


def drive(world, command, seconds, dt=0.2):
    return [world.step(command, dt) for _ in range(round(seconds / dt))]


class TestDifferentialDrive:
    def test_two_seconds_at_full_speed_are_52_cm(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(1.0, 3.0, 0.0))
        drive(world, AHEAD, 1.0)
        start = world.pose
        drive(world, AHEAD, 2.0)
        assert world.pose.x - start.x == pytest.approx(0.52, abs=1e-12)
        assert world.pose.y == start.y

    def test_from_rest_the_ramp_costs_half_its_duration(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(1.0, 3.0, 0.0))
        drive(world, AHEAD, 2.0)
        assert world.pose.x - 1.0 == pytest.approx(0.26 * (2.0 - 0.5 * 0.26 / 2.5), abs=1e-12)

    def test_the_step_length_does_not_matter(self, hall):
        ends = []
        for dt in (0.05, 0.2, 0.7, 4.2):
            world = World(hall, RobotConfig())
            world.reset(Pose2D(3.0, 2.0, 0.0))
            drive(world, Twist2D(0.2, 0.5), 4.2, dt)
            ends.append(world.pose)
        # The ramp's pieces differ; see the kernel's test for the bound.
        assert np.ptp(np.array(ends), axis=0) == pytest.approx(0.0, abs=5e-5)

    def test_a_full_circle_returns_to_its_start(self, hall):
        world = World(hall, RobotConfig(linear_acceleration=1e4, angular_acceleration=1e4))
        world.reset(Pose2D(4.0, 2.0, 0.0))
        drive(world, Twist2D(0.25, 0.5), 4 * math.pi, 4 * math.pi / 100)
        # The ramp to full speed at the highest acceleration takes 50 us, in which the heading falls 13 urad behind.
        assert tuple(world.pose) == pytest.approx((4.0, 2.0, 0.0), abs=2e-5)

    def test_commands_beyond_the_limits_are_cut_off(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(2.0, 3.0, 0.0))
        drive(world, Twist2D(math.inf, -1e9), 2.0)
        assert world.velocity == Twist2D(0.26, -1.82)

    def test_velocity_changes_no_faster_than_the_accelerations(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(2.0, 3.0, 0.0))
        rng = np.random.default_rng(0)
        before = world.velocity
        for _ in range(200):
            world.step(Twist2D(*rng.uniform(-0.3, 0.3, 2)), 0.02)
            assert abs(world.velocity.linear - before.linear) <= 2.5 * 0.02 + 1e-12
            assert abs(world.velocity.angular - before.angular) <= 3.2 * 0.02 + 1e-12
            before = world.velocity

    def test_wheels_roll_what_the_body_moves(self, hall):
        robot = RobotConfig()
        world = World(hall, robot)
        world.reset(Pose2D(4.0, 3.0, 0.0))
        for motion in drive(world, Twist2D(0.1, 1.0), 3.0):
            left, right = motion.wheels
            assert (right - left) / robot.wheel_separation == pytest.approx(
                motion.increment.theta, abs=1e-12
            )
            assert 0.5 * (left + right) == pytest.approx(motion.distance, abs=1e-12)

    @given(st.integers(0, 1000))
    @settings(max_examples=10)
    def test_increments_compose_to_the_pose(self, seed):
        rng = np.random.default_rng(seed)
        world = World(FloorPlan("box", shapely.box(0, 0, 2, 2)), RobotConfig())
        pose = Pose2D(1.0, 1.0, 0.0)
        world.reset(pose)
        for _ in range(50):
            motion = world.step(Twist2D(*rng.uniform(-1, 1, 2)), 0.2)
            pose = compose(pose, motion.increment)
        assert pose[:2] == pytest.approx(world.pose[:2], abs=1e-9)
        assert math.cos(pose.theta - world.pose.theta) == pytest.approx(1.0)


class TestContact:
    def test_driving_into_a_wall_stops_in_front_of_it_and_says_so(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(7.0, 3.0, 0.0))
        contacts = [motion.contact for motion in drive(world, AHEAD, 6.0)]
        assert contacts == sorted(contacts)
        assert contacts[-1]
        assert 8.0 - 0.22 - SKIN <= world.pose.x <= 8.0 - 0.22
        assert world.velocity.linear == pytest.approx(0.0, abs=1e-6)

    def test_blocked_wheels_roll_on(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(7.5, 3.0, 0.0))
        motion = drive(world, AHEAD, 4.0)[-1]
        assert motion.distance == pytest.approx(0.0, abs=1e-6)
        assert motion.wheels[0] == pytest.approx(0.052, abs=1e-6)

    def test_the_robot_can_always_back_off(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(7.0, 3.0, 0.4))
        drive(world, AHEAD, 8.0)
        before = world.pose
        motions = drive(world, Twist2D(-0.26, 0.0), 1.0)
        assert not any(motion.contact for motion in motions[1:])
        assert before.x - world.pose.x > 0.15

    def test_a_disc_slides_along_a_wall_without_turning(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(7.5, 1.0, math.pi / 4))
        drive(world, AHEAD, 10.0)
        assert world.pose.theta == pytest.approx(math.pi / 4, abs=1e-6)
        assert world.pose.y > 2.5

    def test_a_disc_turns_on_the_spot_at_a_wall(self, hall):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(8.0 - 0.22 - 0.001, 3.0, 0.0))
        motions = drive(world, Twist2D(0.0, 1.0), 2.0)
        assert not any(motion.contact for motion in motions)
        assert sum(motion.increment.theta for motion in motions) > 1.8

    def test_both_regimes_drive_alike(self, hall):
        # Along a wall within the handover distance every step is pymunk's; in the middle none is.
        near, far = World(hall, RobotConfig()), World(hall, RobotConfig())
        near.reset(Pose2D(2.0, 0.22 + SKIN + 0.002, 0.0))
        far.reset(Pose2D(2.0, 3.0, 0.0))
        for command in (AHEAD, Twist2D(0.1, 0.0), Twist2D(-0.2, 0.0), Twist2D(0.0, 0.7)):
            for dt in (0.2, 0.33):
                one, other = near.step(command, dt), far.step(command, dt)
                assert not one.contact
                # Pieces of the ramp of another length: the bound of the kernel's own test.
                assert np.allclose(one.increment, other.increment, atol=5e-5, rtol=0)
                assert np.allclose(one.wheels, other.wheels, atol=1e-9, rtol=0)

    def test_a_person_blocks_the_way_and_is_not_run_over(self, hall):
        walkable = Walkable(np.ones((1, 1), dtype=np.bool_), (4.98, 2.98))
        world = World(
            hall,
            RobotConfig(),
            clutter=Clutter(people=(Person((5.0, 3.0), 1.0, 0),), walkable=walkable),
        )
        world.reset(Pose2D(4.0, 3.0, 0.0))
        motions = drive(world, AHEAD, 6.0)
        assert motions[-1].contact
        assert world.pose.x == pytest.approx(5.0 - 0.25 - 0.22, abs=2 * SKIN)


class TestReset:
    def test_a_pose_in_a_wall_or_outside_is_refused(self, hall):
        world = World(hall, RobotConfig())
        for pose, reason in (
            (Pose2D(9.0, 3.0, 0.0), "outside"),
            (Pose2D(7.9, 3.0, 0.0), "no room"),
            (Pose2D(math.nan, 3.0, 0.0), "finite"),
        ):
            with pytest.raises(ConfigError, match=reason):
                world.reset(pose)

    @pytest.mark.parametrize(
        ("command", "dt"), [((math.nan, 0.0), 0.2), ((0.1, 0.1), 0.0), ((0.1, 0.1), math.inf)]
    )
    def test_what_is_not_a_number_is_refused(self, hall, command, dt):
        world = World(hall, RobotConfig())
        world.reset(Pose2D(1.0, 1.0, 0.0))
        with pytest.raises(ValueError, match=r"command|dt"):
            world.step(Twist2D(*command), dt)

    def test_a_used_world_repeats_what_a_fresh_one_does(self, make_random_plan):
        plan = make_random_plan(np.random.default_rng(3))
        robot = RobotConfig()
        start = sample_start(plan, robot, np.random.default_rng(0))
        used = World(plan, robot)
        runs = []
        for world in (used, used, World(plan, robot)):
            world.reset(start)
            rng = np.random.default_rng(1)
            runs.append([world.step(Twist2D(0.26, rng.uniform(-1, 1)), 0.2) for _ in range(150)])
        assert any(motion.contact for motion in runs[0])
        assert runs[0] == runs[1] == runs[2]

    def test_what_the_lidar_sees_can_not_be_written(self, hall):
        segments = World(hall, RobotConfig()).segments()
        assert segments.shape == (4, 4)
        with pytest.raises(ValueError, match="read-only"):
            segments[0] = 0.0


_STEPS = 500


# 15,000 steps together, each world started again in another plan: the walls matter, not the hours.
def test_nothing_lets_the_robot_through_a_wall(make_random_plan):
    contacts = 0
    for seed in range(30):
        rng = np.random.default_rng([seed, 6])
        fast = (
            {"max_linear": 5.0, "max_angular": 6.0, "linear_acceleration": 100.0}
            if seed % 5 == 0
            else {}
        )
        robot = RobotConfig(**fast)
        plan, start = _plan_with_room(make_random_plan, robot, rng)
        world = World(plan, robot)
        world.reset(start)
        poses = np.empty((_STEPS, 3))
        for step in range(_STEPS):
            if step % 20 == 0:
                command = Twist2D(
                    *(rng.choice([-1e9, -1, 0, 0.5, 1, 1, 1e9], 2) * rng.uniform(0, 2, 2))
                )
            dt = 5.0 if step % 250 == 249 else rng.choice([0.02, 0.05, 0.1, 0.2])
            motion = world.step(command, dt)
            contacts += motion.contact
            poses[step] = motion.pose
        _assert_in_free_space(plan, robot.radius, start, poses)
    assert contacts > _STEPS  # otherwise nothing was tried


def _assert_in_free_space(plan, radius, start, poses):
    """The body is in the free space, in the part of it that the robot could reach without passing a wall."""
    distance = shapely.distance(plan.free_space.boundary, shapely.points(poses[:, :2]))
    assert distance.min() >= radius - 1e-9
    # Half a millimetre covers the buffer's arcs, which are drawn as chords.
    parts = shapely.get_parts(plan.free_space.buffer(-radius + 0.0005, quad_segs=32))
    home = next(part for part in parts if part.contains(shapely.Point(start.x, start.y)))
    assert shapely.contains_xy(home, poses[:, 0], poses[:, 1]).all()


def _plan_with_room(make_random_plan, robot, rng):
    while True:
        plan = make_random_plan(rng)
        if not plan.free_space.buffer(-robot.radius - 0.1).is_empty:
            return plan, sample_start(plan, robot, rng)

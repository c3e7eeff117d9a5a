"""What the hand-written rules decide on constructed maps."""

import math

import numpy as np
import pytest

from slamgym.agents.explorer import FrontierExplorer
from slamgym.agents.registry import CLASSICAL, make_explorer
from slamgym.agents.rules import FrontierTour, NextBestView, path_lengths
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, Pose2D
from slamgym.envs import frontier_features


def corridor(make_world, left, right):
    """A corridor of 10 m; its ends are unknown, as deep as said [cells], the robot 1.5 m left of the middle."""
    cells = np.full((30, 200), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    world = make_world(cells)
    world.map[:] = cells
    world.map[1:29, 1 : 1 + left] = UNKNOWN
    world.map[1:29, 199 - right : 199] = UNKNOWN
    world.map[:, 0] = world.map[:, -1] = OCCUPIED
    world.place(15, 70)
    return without_scan(world)


def without_scan(world):
    """The world's observations leave the map as it is."""
    world.scan = lambda: np.full(180, 3.5, np.float32)
    return world


def loop_of(explorer, world, time=0.0):
    """The loop of an explorer that has seen the world."""
    explorer.predict(world.observation(time))
    return explorer._pilots[0].loop


def first_target(rule, world):
    """Column of the place that an explorer by a rule goes to first [cells]."""
    target = loop_of(FrontierExplorer(world.context, rule), world).target.target
    return int(world.truth.frame.to_cell(*target)[1])


def test_the_next_best_view_prefers_gain_until_the_path_outweighs_it(make_world):
    # 3 m to the left a strip of 0.2 m is unknown, 4.5 m to the right one of 2 m.
    world = corridor(make_world, left=4, right=40)
    for weight, side in ((0.1, "right"), (5.0, "left")):
        assert (first_target(NextBestView(path_weight=weight), world) > 70) == (side == "right"), (
            weight
        )


@pytest.mark.parametrize(("weight", "is_left"), [(0.0, True), (1.0, False)])
def test_turning_round_counts_as_path(make_world, monkeypatch, weight, is_left):
    monkeypatch.setattr(frontier_features, "TURN_WEIGHT", weight)
    world = corridor(make_world, left=20, right=60)
    # Alike far: 50 cells to the left, 69 to the right; the robot looks to the right.
    assert (first_target(FrontierTour(), world) < 70) == is_left


def test_the_nearest_is_the_shortest_path_and_explore_lite_weighs_the_straight_distance(make_world):
    world = corridor(make_world, left=20, right=60)
    for name in ("nearest", "explore_lite"):
        loop = loop_of(make_explorer(name, world.context), world)
        scores = make_explorer(name, world.context).rule(loop)
        assert scores.shape == (2,)
        assert loop.target is loop.candidates[int(np.argmax(scores))]
        assert world.truth.frame.to_cell(*loop.target.target)[1] < 70


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_rule_scores_every_candidate(make_world, name):
    cells = np.full((40, 400), FREE)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    world = make_world(cells)
    world.map[:] = cells
    for column in range(10, 390, 30):
        world.map[0, column : column + 15] = (
            UNKNOWN  # 13 gaps of 0.75 m in the wall: more than a tour is exact for
        )
    world.place(20, 200)
    loop = loop_of(make_explorer(name, world.context), without_scan(world))
    assert len(loop.candidates) == len(path_lengths(loop)) == 13
    scores = make_explorer(name, world.context).rule(loop)
    assert scores.shape == (13,)
    assert np.isfinite(scores).all()
    if name == "tour":
        assert sorted(scores) == list(range(-12, 1))


def test_a_goal_that_the_robot_comes_no_nearer_to_is_given_up_for_the_other(make_world):
    world = corridor(make_world, left=20, right=60)
    explorer = make_explorer("nearest", world.context)
    sides = [
        loop_of(explorer, world, 2.0 * step).target.target[0] > world.pose.x for step in range(20)
    ]
    assert not any(sides[:15])  # the robot is held
    assert any(sides[15:])


def test_explorers_with_other_settings_have_other_fingerprints(make_world):
    context = make_world(np.full((20, 20), FREE)).context
    fingerprints = {make_explorer(name, context).fingerprint for name in CLASSICAL}
    assert len(fingerprints) == len(CLASSICAL)
    assert FrontierExplorer(context, NextBestView()).fingerprint in fingerprints
    assert FrontierExplorer(context, NextBestView(path_weight=0.2)).fingerprint not in fingerprints


def test_a_robot_that_turns_keeps_the_order_of_a_tour_within_its_candidates(make_world):
    world = corridor(make_world, left=20, right=60)
    loop = loop_of(make_explorer("tour", world.context), world)
    for heading in (0.0, math.pi / 2, math.pi):
        world.pose = Pose2D(world.pose.x, world.pose.y, heading)
        assert sorted(FrontierTour()(loop)) == [-1.0, 0.0]

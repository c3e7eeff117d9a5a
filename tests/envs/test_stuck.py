"""The paper's rule: a robot is stuck where the ratio of black to white of its map stands still."""

import numpy as np
import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Twist2D
from slamgym.envs import EpisodeConfig, ExploreConfig, run_episode
from slamgym.envs.stuck import MAPS, black_to_white, is_stuck
from slamgym.slam import SlamConfig

FLAT = FloorPlan("flat", box(0, 0, 8, 6).difference(box(4, 0, 4.2, 4.5)))


class Standing:
    """An explorer that never drives and never says that it is done."""

    finished = False

    def reset(self):
        pass

    def predict(self, observation, *_, **__):
        return np.array(Twist2D(0.0, 0.0), dtype=np.float32), None


def standing(*_, **__):
    return Standing()


def explored(make, **settings):
    return run_episode(FLAT, 0, EpisodeConfig(**settings), make)


def test_the_ratio_is_of_occupied_to_free_cells():
    cells = np.array([[0, 254, 254], [205, 254, 254]], np.uint8)
    assert black_to_white(cells) == 0.25
    assert black_to_white(np.full((2, 2), 205, np.uint8)) == 0.0


@pytest.mark.parametrize(
    ("ratios", "stuck"),
    [
        ([0.1] * MAPS, False),  # too short a time
        ([0.1] * (MAPS + 1), True),
        ([0.5] + [0.1] * (MAPS + 1), True),  # what was before doesn't count
        ([0.1] * MAPS + [0.107], True),  # as much as noise may
        ([0.1] * MAPS + [0.11], False),
        ([0.1, 0.2] + [0.1] * (MAPS - 1), False),  # there and back
        (list(np.linspace(0.1, 0.11, MAPS + 1)), False),  # slow, but it moves
    ],
)
def test_a_ratio_stands_still_if_it_changes_no_more_than_noise_does(ratios, stuck):
    assert is_stuck(ratios) == stuck


@pytest.mark.parametrize("mode", ["pose_graph", "ground_truth"])
def test_a_robot_that_stands_ends_as_stuck_and_only_if_asked(mode):
    env = ExploreConfig(slam=SlamConfig(mode=mode))
    episode = explored(standing, minutes=4, stuck_after=1, env=env)
    assert episode.finished == "stuck"
    # A minute is the least; before, its map takes a while to fill.
    assert 60.0 <= episode.robot_seconds < 180.0
    waits = explored(standing, minutes=2, env=env)
    assert waits.finished == "time_limit"
    assert waits.robot_seconds == pytest.approx(120.0, abs=0.2)  # by the last scan


def test_an_exploration_that_gets_on_is_what_it_was():
    plain = explored(make_explorer, explorer="nearest", minutes=4)
    watched = explored(make_explorer, explorer="nearest", minutes=4, stuck_after=1)
    assert plain.robot_seconds > 70.0  # more than the rule takes
    assert watched.finished == plain.finished == "explored"
    assert np.array_equal(watched.slam_map.cells, plain.slam_map.cells)


def test_a_senseless_time_is_refused():
    with pytest.raises(ConfigError, match="stuck_after"):
        EpisodeConfig(stuck_after=0)

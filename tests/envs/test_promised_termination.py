"""An environment's episode that ends when the map keeps a promise."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.completion import CompletionDetector
from slamgym.planning.promise import Promise

FRAME = GridFrame(0.05, -6.0, -6.0, 240, 240)


def room(door):
    """A square room of 6 m with a door of some width in its east wall [m]."""
    cells = np.full(FRAME.shape, UNKNOWN, np.uint8)
    x, y = FRAME.to_point(*np.indices(FRAME.shape))
    far = np.maximum(np.abs(x), np.abs(y))
    cells[far < 3.0] = FREE
    cells[(far >= 3.0) & (far < 3.1) & ~((x > 0.0) & (np.abs(y) < 0.5 * door))] = OCCUPIED
    return OccupancyGrid(cells, FRAME)


def test_a_closed_room_keeps_the_promise_and_an_open_door_does_not():
    detector = CompletionDetector(0.22, 0.35, Promise(0.98, None, 0.92))
    here = Pose2D(0.0, 0.0, 0.0)
    assert detector.is_explored(room(door=0.0), here)
    assert not detector.is_explored(room(door=1.0), here)


def test_the_setting_is_a_written_promise():
    config = ExploreConfig(terminate_when_explored="95%:80%")
    assert config.promise == Promise(0.95, None, 0.8)
    assert ExploreConfig().promise is None
    with pytest.raises(ConfigError, match="no promise"):
        ExploreConfig(terminate_when_explored="soon")
    env = ExploreEnv("bundled", localization="ground_truth", terminate_when_explored="98%")
    env.reset(seed=0)
    assert not env.step(np.zeros(2, np.float32))[2]

"""The log of an episode."""

import numpy as np
import pytest

from slamgym.core.types import Pose2D
from slamgym.envs import EpisodeLog


def fill(log: EpisodeLog, count: int) -> None:
    for i in range(len(log), len(log) + count):
        log.append(
            stamps=0.2 * i,
            true_poses=(i, 1.0, 0.1),
            odometry=(i, 2.0, 0.2),
            estimates=(i, 3.0, 0.3),
            ranges=np.full(4, i),
        )


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 300])
def test_everything_appended_is_there(count: int):
    log = EpisodeLog(num_beams=4)
    fill(log, count)
    assert len(log) == count
    assert log.stamps == pytest.approx(0.2 * np.arange(count))
    for poses, y in ((log.true_poses, 1.0), (log.odometry, 2.0), (log.estimates, 3.0)):
        assert poses.shape == (count, 3)
        assert np.array_equal(poses[:, 0], np.arange(count))
        assert (poses[:, 1] == y).all()
    assert np.array_equal(
        log.ranges, np.repeat(np.arange(count, dtype=np.float32), 4).reshape(-1, 4)
    )


def test_what_is_handed_out_can_not_be_changed():
    log = EpisodeLog(num_beams=4)
    fill(log, 3)
    for array in (log.stamps, log.true_poses, log.ranges):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0
    fill(log, 1)  # the log itself goes on
    assert len(log) == 4


def test_the_true_trajectory_starts_at_the_origin_of_the_map():
    log = EpisodeLog(num_beams=4)
    fill(log, 3)
    path = log.true_trajectory(Pose2D(0.0, 1.0, 0.1))
    assert path.poses == pytest.approx(np.array([[0, 0, 0.1], [1, 0, 0.1], [2, 0, 0.1]]))

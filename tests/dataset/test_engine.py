import os
import signal

import pytest

from slamgym.dataset.engine import WorkerLostError, run_tasks


def square(value):
    return value * value


def fail_on_three(value):
    if value == 3:
        raise ValueError("three")
    return value


def die_on_three(value):
    if value == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def thread_settings(_):
    import cv2

    return cv2.getNumThreads(), os.environ.get("NUMBA_NUM_THREADS"), os.environ.get("OMP_NUM_THREADS")


@pytest.mark.parametrize("workers", [1, 2])
def test_every_item_is_done_once(workers):
    assert sorted(run_tasks(square, range(9), workers)) == [i * i for i in range(9)]


def test_items_are_drawn_only_a_little_ahead():
    drawn = 0

    def items():
        nonlocal drawn
        for i in range(50):
            drawn += 1
            yield i

    for done, _ in enumerate(run_tasks(square, items(), workers=2), start=1):
        assert drawn <= done + 2 * 2


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_ends_the_run(workers):
    with pytest.raises(ValueError, match="three"):
        list(run_tasks(fail_on_three, range(9), workers))


def test_a_killed_worker_is_a_clear_error():
    with pytest.raises(WorkerLostError, match="killed"):
        list(run_tasks(die_on_three, range(9), 2))
    assert sorted(run_tasks(square, range(3), 2)) == [0, 1, 4]  # and the next run works


def test_workers_compute_on_one_thread():
    assert set(run_tasks(thread_settings, range(4), 2)) == {(1, "1", "1")}

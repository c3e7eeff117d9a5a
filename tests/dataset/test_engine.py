import os
import signal
import subprocess
import sys
import time

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


def test_one_worker_does_every_item_in_order():
    assert list(run_tasks(square, range(9), 1)) == [i * i for i in range(9)]


def test_two_workers_do_every_item_once_and_draw_only_a_little_ahead():
    drawn = 0

    def items():
        nonlocal drawn
        for i in range(50):
            drawn += 1
            yield i

    results = []
    for result in run_tasks(square, items(), workers=2):
        results.append(result)
        assert drawn <= len(results) + 2 * 2
    assert sorted(results) == [i * i for i in range(50)]


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_ends_the_run(workers):
    with pytest.raises(ValueError, match="three"):
        list(run_tasks(fail_on_three, range(9), workers))


def test_a_killed_worker_is_a_clear_error_and_the_next_run_works():
    with pytest.raises(WorkerLostError, match="killed"):
        list(run_tasks(die_on_three, range(9), 2))
    # Every worker computes on one thread.
    assert set(run_tasks(thread_settings, range(4), 2)) == {(1, "1", "1")}


@pytest.mark.skipif(os.name != "posix", reason="looks at parent processes")
def test_workers_end_when_their_parent_is_killed(tmp_path):
    code = (
        "import os\nfrom slamgym.dataset.engine import run_tasks\n"
        "def pid(_):\n    import os, time\n    time.sleep(0.2)\n    return os.getpid()\n"
        "for found in run_tasks(pid, range(1000), 2):\n    print(found, flush=True)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    with parent, parent.stdout as lines:
        workers = {int(lines.readline()) for _ in range(6)}
        parent.kill()
    assert workers
    deadline = time.monotonic() + 20.0
    while any(map(_is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(_is_alive, workers))


def _is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True

"""What the engines promise, on the processes of this machine."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from core.engine_tasks import (
    crash,
    die_at_first,
    die_on_three,
    fail_on_three,
    hang,
    note_pid,
    pid_of,
    square,
    thread_settings,
)

from slamgym.core.errors import ConfigError, PlanError, SlamgymError
from slamgym.core.parallel import engine as module
from slamgym.core.parallel.backlog import (
    MAX_ATTEMPTS,
    MAX_LOST_IN_A_ROW,
    Attempt,
    Backlog,
    Lost,
    WorkerLostError,
    tried,
)
from slamgym.core.parallel.engine import Execution, run_apart, run_tasks, try_out

# loky's own thread may stumble over a task that was taken back while its process was being ended.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception in thread ExecutorManagerThread:pytest.PytestUnhandledThreadExceptionWarning"
)


@pytest.fixture(scope="module")
def engine():
    with Execution(2).open() as engine:
        yield engine


@pytest.fixture(scope="module")
def one_worker():
    with Execution(1).open() as engine:
        yield engine


def test_one_worker_does_every_item_in_order(one_worker):
    assert list(run_tasks(square, range(9), 1)) == [i * i for i in range(9)]
    assert list(one_worker.run(square, range(9))) == [i * i for i in range(9)]
    assert set(one_worker.run(pid_of, range(2))) != {os.getpid()}
    with Execution(engine="in_process").open() as engine:
        assert set(engine.run(pid_of, range(2))) == {os.getpid()}


def test_a_crash_costs_one_task_with_one_worker_too(one_worker):
    """Native code that crashes, or ends its process."""
    results = list(one_worker.run(crash, ["SIGSEGV", "exit", "well"]))
    assert [r.item if isinstance(r, Lost) else r for r in results] == ["SIGSEGV", "exit", "well"]
    assert (
        results[0].reason == f"a worker process died (SIGSEGV) at each of {MAX_ATTEMPTS} attempts"
    )
    assert results[1].reason == f"a worker process died at each of {MAX_ATTEMPTS} attempts"


@pytest.mark.parametrize(
    ("error", "kind", "reason"),
    [
        (ZeroDivisionError("by zero"), "ZeroDivisionError", "by zero (in test_engine.py:"),
        (SystemExit(3), "SystemExit", "3 (in test_engine.py:"),
        (
            FileNotFoundError(2, "missing"),
            "FileNotFoundError",
            "[Errno 2] missing (in test_engine.py:",
        ),
        (PlanError("p", "is too small"), "PlanError", "is too small"),
    ],
)
def test_a_task_that_fails_costs_itself(error, kind, reason):
    def fail(_):
        raise error

    lost = tried(fail, 7)
    assert (lost.item, lost.error) == (7, kind)
    assert lost.reason.startswith(reason)


def test_an_interruption_while_c_code_ran_is_one():
    def fail(_):
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    with pytest.raises(KeyboardInterrupt):
        tried(fail, 7)


def test_a_wrong_setting_or_memory_that_runs_out_ends_the_run():
    def fail(error):
        raise error

    with pytest.raises(SlamgymError, match=r"memory ran out; .*fewer --workers"):
        tried(fail, MemoryError())
    with pytest.raises(ConfigError, match="wrong"):
        tried(fail, ConfigError("wrong"))


def test_a_crash_is_told_by_its_sentence_alone(capfd, monkeypatch):
    monkeypatch.delenv("PYTHONFAULTHANDLER", raising=False)
    with (
        Execution(1).open() as engine,
        pytest.raises(ConfigError, match=r"a worker process died \(SIGSEGV\)"),
    ):
        try_out(engine, crash, ["SIGSEGV"])
    assert "Fatal Python error" not in capfd.readouterr().err


def test_what_is_tried_out_first_is_refused_by_its_name(one_worker):
    assert try_out(one_worker, str.upper, ["a", "b"]) == {"a": "A", "b": "B"}
    with pytest.raises(
        ConfigError, match=r"'SIGSEGV' can't be used .WorkerLostError.: a worker process died"
    ):
        try_out(one_worker, crash, ["well", "SIGSEGV"])


def test_what_crashes_or_hangs_apart_leaves_this_process_alone(tmp_path):
    assert run_apart(pid_of, 0, 1.0) != os.getpid()
    assert isinstance(run_apart(crash, "SIGSEGV", 1.0), Lost)
    assert isinstance(run_apart(hang, (tmp_path, "lock"), 1.0), Lost)
    assert run_apart(pid_of, 0, 1.0) == run_apart(pid_of, 0, 1.0)


def test_a_task_that_hangs_is_ended_with_its_worker(tmp_path):
    with Execution(1, task_timeout=1.0).open() as engine:
        results = list(
            engine.run(hang, [(tmp_path, "lock"), (tmp_path, "loop"), (tmp_path, "well")])
        )
    assert results == [
        *(
            Lost((tmp_path, how), "took longer than 1 s, the --task-timeout", "TimeoutError")
            for how in ("lock", "loop")
        ),
        "well",
    ]
    # It would hang again: there is no second attempt.
    assert len(list(tmp_path.iterdir())) == 3


def test_two_workers_do_every_item_once_and_draw_only_a_little_ahead(engine):
    drawn = 0

    def items():
        nonlocal drawn
        for i in range(50):
            drawn += 1
            yield i

    results = []
    for result in engine.run(square, items()):
        results.append(result)
        # In hand, ready beside it, and come in together with this result.
        assert drawn <= len(results) + 3 * 2
    assert sorted(results) == [i * i for i in range(50)]


def test_an_error_ends_the_run(engine):
    with pytest.raises(ValueError, match="three"):
        list(run_tasks(fail_on_three, range(9), 1))
    with pytest.raises(ValueError, match="three"):
        list(engine.run(fail_on_three, range(9)))


def test_an_engine_runs_again_after_a_run_that_was_given_up(engine):
    for _ in engine.run(square, range(50)):
        break
    assert sorted(engine.run(square, range(5))) == [0, 1, 4, 9, 16]
    # Every worker computes on one thread.
    assert set(engine.run(thread_settings, range(4))) == {(1, "1", "1")}
    # The processes live as long as the engine.
    first = set(engine.run(pid_of, range(4)))
    assert set(engine.run(pid_of, range(4))) == first
    assert len(first) == 2


def test_a_task_whose_worker_dies_is_tried_again(engine, tmp_path):
    items = [(tmp_path, value) for value in range(9)]
    assert sorted(engine.run(die_at_first, items)) == list(range(9))


def test_a_task_that_kills_every_worker_is_handed_back_and_the_others_are_done(engine, tmp_path):
    items = [(tmp_path, value) for value in range(8)]
    results = list(engine.run(die_on_three, items))
    lost = [result for result in results if isinstance(result, Lost)]
    assert [entry.item for entry in lost] == [(tmp_path, 3)]
    assert "(SIGKILL)" in lost[0].reason
    assert sorted(result for result in results if not isinstance(result, Lost)) == [
        0,
        1,
        2,
        4,
        5,
        6,
        7,
    ]
    begun = [int(path.name.split("-")[0]) for path in tmp_path.iterdir()]
    # The others are begun once: they don't suffer with their neighbour.
    assert sorted(begun) == sorted([*range(8), *[3] * (MAX_ATTEMPTS - 1)])


def test_a_task_that_may_not_be_lost_is_a_clear_error(monkeypatch):
    class Unlucky:
        def run(self, task, items):
            yield from (Lost(item, "a worker process was killed") for item in items)

    monkeypatch.setattr(module.Execution, "open", lambda _: contextlib.nullcontext(Unlucky()))
    with pytest.raises(WorkerLostError, match="was killed; run the same command again"):
        list(run_tasks(square, range(8), workers=2))


def test_a_task_is_tried_again_before_fresh_ones_and_then_given_up():
    backlog = Backlog("ab")
    attempt = backlog.pop()
    for _ in range(MAX_ATTEMPTS - 1):
        assert attempt.item == "a"
        assert backlog.worker_died(attempt, "a worker was killed") is None
        attempt = backlog.pop()
    lost = backlog.worker_died(attempt, "a worker was killed")
    assert lost == Lost("a", f"a worker was killed at each of {MAX_ATTEMPTS} attempts")
    assert backlog.pop().item == "b"
    assert backlog.pop() is None


def test_task_after_task_lost_is_the_machine_s_fault():
    backlog = Backlog([])
    last = Attempt("plan", MAX_ATTEMPTS, time.monotonic())
    for _ in range(3):  # a result between them shows that the machine is fit
        for _ in range(MAX_LOST_IN_A_ROW - 1):
            assert backlog.worker_died(last, "a worker was killed") is not None
        backlog.succeeded()
    for _ in range(MAX_LOST_IN_A_ROW - 1):
        backlog.worker_died(last, "a worker was killed")
    with pytest.raises(WorkerLostError, match="memory is short"):
        backlog.worker_died(last, "a worker was killed")


def test_task_after_task_that_takes_too_long_is_the_limit_s_fault():
    backlog = Backlog([], timeout=60.0)
    slow = Attempt("plan", 1, time.monotonic() - 61.0)
    for _ in range(MAX_LOST_IN_A_ROW - 1):
        assert backlog.worker_died(slow, "a worker died").error == "TimeoutError"
    with pytest.raises(
        WorkerLostError, match=r"took longer than 1 min; .* a longer --task-timeout"
    ):
        backlog.worker_died(slow, "a worker died")


def test_workers_killed_from_outside_lose_nothing(engine, tmp_path):
    """Each kill hits a worker at a random moment: at work, or between two tasks."""
    rng = random.Random(1)
    results = []
    for result in engine.run(note_pid, [(tmp_path, value) for value in range(40)]):
        results.append(result)
        if len(results) in (7, 23):
            time.sleep(rng.uniform(0.0, 0.05))
            _kill_one(tmp_path, rng)
    assert sorted(results) == list(range(40))


def _kill_one(folder, rng):
    for pid in rng.sample(pids := sorted(int(path.name) for path in folder.iterdir()), len(pids)):
        (folder / str(pid)).unlink()
        if _is_alive(pid):
            os.kill(pid, rng.choice([signal.SIGKILL, signal.SIGTERM]))
            return


@pytest.mark.skipif(os.name != "posix", reason="looks at parent processes")
def test_workers_end_when_their_parent_is_killed(tmp_path):
    code = (
        "import os\nfrom slamgym.core.parallel.engine import run_tasks\n"
        "def pid(_):\n    import os, time\n    time.sleep(0.2)\n    return os.getpid()\n"
        "for found in run_tasks(pid, range(1000), 2):\n    print(found, flush=True)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    with parent, parent.stdout as lines:
        workers = {int(lines.readline()) for _ in range(6)}
        parent.kill()
    assert workers
    deadline = time.monotonic() + 120.0
    while any(map(_is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(_is_alive, workers))


@pytest.mark.parametrize(
    ("options", "words"),
    [({"workers": 0}, "at least 1"), ({"workers": 2, "address": "auto"}, "--engine ray")],
)
def test_senseless_options_are_refused(options, words):
    with pytest.raises(ConfigError, match=words):
        Execution(**options).open()


def _is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True

"""What workers do in the tests of the engines, in a module of its own: each of many workers imports it."""

import ctypes
import os
import signal
import time


def square(value):
    return value * value


def fail_on_three(value):
    if value == 3:
        raise ValueError("three")
    return value


def die_on_three(item):
    """Note each attempt in a folder; item 3 kills its worker every time."""
    folder, value = item
    (folder / f"{value}-{time.monotonic_ns()}").touch()
    if value == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def die_at_first(item):
    """Kill the worker at the first attempt of item 2."""
    folder, value = item
    marker = folder / str(value)
    if value == 2 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def note_pid(item):
    """Leave the process id where the test finds it, and work for a moment."""
    folder, value = item
    (folder / str(os.getpid())).touch()
    time.sleep(0.05)
    return value


def thread_settings(_):
    import cv2

    return (
        cv2.getNumThreads(),
        os.environ.get("NUMBA_NUM_THREADS"),
        os.environ.get("OMP_NUM_THREADS"),
    )


def crash(how):
    if how == "SIGSEGV":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how == "exit":
        os._exit(0)
    return how


def hang(item):
    """Without end, in Python, or in native code that never gives the interpreter's lock back."""
    folder, how = item
    (folder / f"{how}-{time.monotonic_ns()}").touch()
    while how == "loop":
        pass
    if how == "lock":
        ctypes.PyDLL(None).sleep(1000)
    return how


def pid_of(_):
    return os.getpid()

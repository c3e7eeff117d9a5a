"""Explorers of several robots, each in a process and a namespace of its own, and what merges their maps."""

import dataclasses
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from slamgym.core.interruption import deferred_interrupt
from slamgym.core.progress import say
from slamgym.ros2.demo import end_process
from slamgym.ros2.parameters import ExploreParameters, FrameNames

_LOOK = 0.5
"""The processes are looked at so often [s]."""


def run_team(
    parameters: ExploreParameters, robots: Sequence[str], ros_arguments: Sequence[str]
) -> int:
    """Explore with several robots until all are done, or it is interrupted.

    An explorer that ends early doesn't end the others; each node's frames are those of a robot alone below its name.

    Args:
        parameters: Of each explorer.
        robots: Their namespaces.
        ros_arguments: What follows ``--ros-args``, which itself comes first.

    Returns:
        0 if all explorers have ended well, else 1.
    """
    merge = ["merge", "--robots", *robots, "--out", str(parameters.out / "merged")]
    commands = {name: explorer_words(parameters, name) for name in robots}
    merging = _start(merge, ros_arguments, ())
    explorers: dict[str, subprocess.Popen[bytes]] = {}
    try:
        with deferred_interrupt() as interruption:
            for name, words in commands.items():
                explorers[name] = _start(words, ros_arguments, ("-r", f"__ns:=/{name}"))
            running = dict(explorers)
            while running and not interruption.requested:
                for name, process in list(running.items()):
                    if process.poll() is not None:
                        del running[name]
                        outcome = "is done" if process.returncode == 0 else "has ended early"
                        say(f"{name} {outcome}; its map so far is merged")
                time.sleep(_LOOK)
    finally:
        for process in (*explorers.values(), merging):
            end_process(process)
    return int(any(process.returncode for process in explorers.values()))


def explorer_words(parameters: ExploreParameters, name: str) -> list[str]:
    """The command of one robot's explorer, as it is typed: frames and folder below its name."""
    own: dict[str, Any] = {"robots": None, "out": parameters.out / name}
    for frame in ("map_frame", "odom_frame", "base_frame"):
        given = getattr(parameters, frame)
        is_default = given == getattr(FrameNames(), frame)
        own[frame] = f"{name}/{given}" if is_default else given
    changed = dataclasses.replace(parameters, **own)
    words = ["explore"]
    for field in dataclasses.fields(changed):
        value = getattr(changed, field.name)
        option = f"--{field.name.replace('_', '-')}"
        if value == field.default:
            continue
        if isinstance(value, bool):
            words.append(option if value else option.replace("--", "--no-", 1))
        else:
            words += [option, *map(str, value if isinstance(value, tuple) else (value,))]
    return words


def _start(
    words: Sequence[str], ros_arguments: Sequence[str], own: Sequence[str]
) -> subprocess.Popen[bytes]:
    """Start a node; Ctrl-C reaches this process alone, which ends them in order."""
    ros = [*(ros_arguments or ("--ros-args",)), *own]
    command = [sys.executable, "-P", "-m", "slamgym", "ros2", *words, *ros]
    return subprocess.Popen(command, start_new_session=True)

"""Faults that ``benchmarks/slam/mapping.py`` puts into logs."""

import dataclasses

import numpy as np
import pytest
from faults import FAULTS, FAULTS_EVERYWHERE, Span, everything, jumped, late, scaled, stretch

from slamgym.core.geometry import between, compose
from slamgym.core.types import LaserGeometry, LaserScan, Pose2D
from slamgym.interop import Log, LogRecord

GEOMETRY = LaserGeometry(1, 0.0, 0.1, 0.1, 8.0)
STEP = Pose2D(0.1, 0.0, 0.05)
SPAN = Span(20.0, 30.0)
WHOLE = pytest.approx(STEP, abs=1e-9)


@pytest.fixture
def log():
    """A hundred seconds along a circle."""
    pose, records = Pose2D(1.0, 2.0, 0.3), []
    for k in range(201):
        records.append(
            LogRecord(0.5 * k, pose, LaserScan(0.5 * k, np.ones(1, np.float32), GEOMETRY))
        )
        pose = compose(pose, STEP)
    return Log("circle", records, GEOMETRY)


def steps(log):
    """The end of each step in time, and the step."""
    pairs = zip(log.records, log.records[1:], strict=False)
    return [(b.stamp, between(a.odometry, b.odometry)) for a, b in pairs]


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_in_a_stretch_leaves_the_rest_as_it_was(log, name):
    for stamp, step in steps(FAULTS[name](log, SPAN)):
        gap = name == "lost second" and stamp == SPAN.begin + 1.5
        assert step == WHOLE or SPAN.begin < stamp <= SPAN.end or gap, stamp


@pytest.mark.parametrize("name", [*FAULTS, *FAULTS_EVERYWHERE])
def test_a_fault_changes_something(log, name):
    broken = {**FAULTS, **FAULTS_EVERYWHERE}[name](log, SPAN if name in FAULTS else everything(log))
    assert len(broken) < len(log) or any(step != WHOLE for _, step in steps(broken))


def test_steps_are_scaled(log):
    inside = [step for stamp, step in steps(scaled(log, SPAN, -1.0, 0.5)) if 20.0 < stamp <= 30.0]
    assert len(inside) == 20
    assert inside == [pytest.approx((-0.1, 0.0, 0.025), abs=1e-9)] * 20


def test_a_jump_is_one_step(log):
    jump = Pose2D(4.0, -4.0, 1.0)
    changed = [step for _, step in steps(jumped(log, SPAN, jump)) if step != WHOLE]
    assert changed == [pytest.approx(compose(STEP, jump), abs=1e-9)]


def test_late_odometry_is_that_of_an_earlier_scan(log):
    odometry = [record.odometry for record in late(log, 1.0)]
    assert odometry[2:] == [pytest.approx(record.odometry, abs=1e-9) for record in log.records[:-2]]
    assert odometry[0] == odometry[1]


def test_the_stretch_of_a_fault_is_inside_and_harmful(log):
    begin, end, _ = stretch(log)
    moved = [step for stamp, step in steps(log) if begin < stamp <= end]
    assert log.records[0].stamp < begin < end < log.records[-1].stamp
    assert end - begin >= 10.0
    assert sum(step.x for step in moved) >= 2.0
    assert sum(step.theta for step in moved) >= 0.5


def test_a_robot_at_rest_has_no_harmful_stretch(log):
    rest = dataclasses.replace(log, records=[r._replace(odometry=STEP) for r in log.records])
    assert stretch(rest) == everything(rest)

"""Drawings that were slow: each is read, or refused, in a process of its own that measures what it costs."""

import sys

import attacks
import drawing_attacks
import pytest

DRAWINGS = {"short walls round a gap": (drawing_attacks.open_ring, "accepted")}


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory as Linux counts it")
@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_costs_a_second(name, tmp_path):
    make, words = DRAWINGS[name]
    loops, megabytes, message = attacks.measure("plans", make(tmp_path))
    assert words in message
    assert len(message) < len(str(tmp_path)) + 250
    assert loops < attacks.MAX_LOOPS
    assert megabytes < attacks.MAX_MEGABYTES

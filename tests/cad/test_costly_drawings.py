"""Drawings that were slow: each is read, or refused, in a process of its own that measures what it costs."""

import sys

import attacks
import drawing_attacks
import pytest

MAX_SECONDS, MAX_MEGABYTES = 2.0, 100.0
"""On a quiet core all cost less than half of the seconds; a core shared with others takes twice as long."""

DRAWINGS = {
    "short walls round a gap": (drawing_attacks.open_ring, "accepted"),
}


@pytest.mark.skipif(sys.platform != "linux", reason="measures memory as Linux counts it")
@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_costs_a_second(name, tmp_path):
    make, words = DRAWINGS[name]
    seconds, megabytes, message = attacks.measure("plans", make(tmp_path))
    assert words in message
    assert len(message) < len(str(tmp_path)) + 250
    assert seconds < MAX_SECONDS
    assert megabytes < MAX_MEGABYTES

import dataclasses

import pytest
from shapely import Polygon, box

from slamgym.cad import FloorPlan, Room
from slamgym.cad.plan_filter import passes
from slamgym.core.progress import duration, show_progress


def test_without_a_terminal_the_end_is_a_line(capsys):
    with show_progress("pairs", 1, 3) as advance:
        advance()
        advance()
    assert capsys.readouterr().err.splitlines()[-1].startswith("3/3 pairs, ")


@pytest.mark.parametrize(
    ("seconds", "words"), [(41.4, "41 s"), (180, "3 min"), (7500, "2 h 05 min")]
)
def test_durations_in_words(seconds, words):
    assert duration(seconds) == words


def _plan(polygon, rooms):
    rooms = tuple(Room("room", polygon) for _ in range(rooms))
    return FloorPlan("plan", polygon, rooms, source="json.tar.gz:plan.json")


@pytest.mark.parametrize(
    ("plan", "useful"),
    [
        (_plan(box(0, 0, 10, 8), 5), True),
        (_plan(box(0, 0, 10, 8), 1), False),
        (_plan(box(0, 0, 10, 8), 21), False),
        (_plan(box(0, 0, 4, 4), 2), False),
        (_plan(box(0, 0, 20, 20), 5), False),
        (_plan(box(0, 0, 31, 5), 5), False),
        (
            _plan(
                Polygon(
                    [(x, 8 + 0.001 * (x % 0.02)) for x in [i * 0.005 for i in range(1600)]]
                    + [(8, 0), (0, 0)]
                ),
                5,
            ),
            False,
        ),
    ],
)
def test_the_useful_filter(plan, useful):
    assert passes(plan, "useful") is useful
    assert passes(plan, "none")
    assert passes(dataclasses.replace(plan, source="procedural"), "useful")

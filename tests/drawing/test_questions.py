"""A person is asked about boundaries that may be wrong, the most doubtful first, and answers are corrections."""

import dataclasses

import pytest
import shapely
from browser import needs_browser, run_in_page
from drawing.painted import FLAT, painted

from slamgym.drawing import make_drawing
from slamgym.drawing.drawing import Question
from slamgym.drawing.edits import Correction, Corrections, map_digest, read_corrections
from slamgym.drawing.formats.html import format_html
from slamgym.drawing.openings import Gap, divide
from slamgym.drawing.questions import MOST_ASKED, doubtful_boundaries

HALL = shapely.MultiPolygon([shapely.box(0, 0, 20, 3)])


def across(x, odds):
    return Gap((x, 0.0), (x, 3.0), odds)


def asked(division, others, corrections=()):
    return [
        (question.start[0], question.is_drawn)
        for question in doubtful_boundaries(division, others, corrections)
    ]


def test_the_most_doubtful_boundaries_are_asked_about_first_whether_drawn_or_not():
    division = divide(HALL, [across(5.0, 1.5), across(10.0, 9.0)])
    others = [across(15.0, -0.5), across(7.0, -2.5)]
    assert asked(division, others) == [(15.0, False), (5.0, True)]


def test_a_line_that_makes_no_two_rooms_is_not_asked_about():
    division = divide(HALL, [])
    niche = across(0.2, -0.1)
    nowhere = Gap((30.0, 0.0), (30.0, 3.0), -0.1)
    assert asked(division, [niche, nowhere]) == []


def test_no_more_is_asked_than_a_person_answers_and_nothing_twice():
    others = [across(2.0 + 2.0 * k, -0.1 * k) for k in range(MOST_ASKED + 3)]
    division = divide(HALL, [])
    assert len(asked(division, others)) == MOST_ASKED
    beside = [across(2.0, -0.1), across(2.2, -0.2)]
    assert asked(division, beside) == [(2.0, False)]
    said = Correction("no_door", line=((2.0, 0.0), (2.0, 3.0)))
    assert asked(division, beside, [said]) == []


GRID, _, MODEL = painted(FLAT)
PLAIN = make_drawing(GRID, "flat", MODEL)
(DOOR,) = PLAIN.doors


def corrected(*entries):
    corrections = Corrections(entries, {"sha256": map_digest(PLAIN.grid)})
    return make_drawing(GRID, "flat", MODEL, corrections=corrections)


def test_where_a_person_sees_no_door_none_is_drawn_and_none_need_have_been():
    drawing = corrected(
        Correction("no_door", line=(DOOR.start, DOOR.end)),
        Correction("no_door", line=((1.0, 1.0), (1.9, 1.0))),
    )
    assert len(drawing.rooms) == 1
    assert not any("correction" in doubt for doubt in drawing.doubts)


@needs_browser
def test_each_question_is_answered_by_one_click(tmp_path):
    questions = (
        Question(DOOR.start, DOOR.end, 0.2, is_drawn=True),
        Question((0.0, 3.2), (2.5, 3.2), -0.4, is_drawn=False),
        Question((0.0, 1.0), (4.0, 1.0), -0.6, is_drawn=False),
    )
    clicks = """
      const byId = (id) => document.getElementById(id), said = [byId("question").textContent];
      byId("no").click(); byId("yes").click(); byId("pass").click();
      said.push(byId("asking").hidden);
      byId("undo").click();
      said.push(byId("question").textContent);
      byId("redo").click();
      return [...said, byId("json").value];
    """
    page = format_html(dataclasses.replace(PLAIN, questions=questions))
    first, is_done, again, saved = run_in_page(page, clicks, tmp_path)
    assert first.startswith("3 to answer.")
    assert is_done
    assert "2.50 m wide and not drawn" in again
    path = tmp_path / "flat.corrections.json"
    path.write_text(saved)
    corrections = read_corrections(path)
    assert [entry.kind for entry in corrections.corrections] == ["no_door", "split"]
    drawing = make_drawing(GRID, "flat", MODEL, corrections=corrections)
    assert sorted(round(room.area, 1) for room in drawing.rooms) == pytest.approx(
        [4.5, 22.3], abs=0.2
    )

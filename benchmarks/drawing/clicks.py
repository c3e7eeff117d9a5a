"""Correct drawings of real maps by clicks in a browser, as a person would, and count them.

    python benchmarks/drawing/boundaries.py real_rooms -o out/rooms
    python benchmarks/drawing/clicks.py real_rooms out/rooms/slam2cad

The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``, and their ``score.py``. Six maps whose drawings
aren't usable, made by weights that were fitted without their buildings, are opened in headless Chromium, whose mouse
this program moves. It answers the report's questions, joins what is drawn as two rooms and is one, and adds the doors
that lack, all as the annotation has it; what the page saves then is drawn. Every press of the mouse is a click: one for
an answer or a boundary that goes, two for a door, one for a tool, one where the page enlarges a place first.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from shapely import Point

from slamgym.core.types import FloatArray
from slamgym.drawing import Drawing, make_drawing
from slamgym.drawing.boundaries import BoundaryModels
from slamgym.drawing.drawing import DrawnPoint, Segment
from slamgym.drawing.edits import read_corrections
from slamgym.drawing.formats.html import format_html
from slamgym.drawing.formats.json import format_json

sys.path.insert(0, str(Path(__file__).parents[1]))
from annotated import WIDEST_DOOR, AnnotatedMap, scorer
from boundaries import BESIDE_LINE, NETWORK, fit, folds, prepared_examples, raise_constant
from browser import Page
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""
MAPS = 6
RAISED = 1.2
"""Of the constants, as all folds chose it when the clicks were counted."""
SAME_PLACE = 0.6
"""A boundary that is drawn or corrected so near to a true one is that one [m]."""
COLUMNS = (
    "map", "set", "questions", "clicks", "room F1", "then", "usable", "then usable",
)  # fmt: skip
QUESTION = """(() => {
  const line = document.querySelector(".editor svg line.question");
  if (!line || document.getElementById("asking").hidden) return null;
  const { left, top } = line.ownerSVGElement.dataset, { x1, y1, x2, y2 } = line;
  const onMap = (x, y) => [+left + x.baseVal.value / 1000, +top - y.baseVal.value / 1000];
  return [onMap(x1, y1), onMap(x2, y2)];
})()"""
PLACE = """(([placeX, placeY]) => {
  const svg = document.querySelector(".editor svg"), box = svg.viewBox.baseVal;
  const x = 1000 * (placeX - svg.dataset.left), y = 1000 * (svg.dataset.top - placeY);
  if (x < box.x || y < box.y || x > box.x + box.width || y > box.y + box.height) return null;
  const at = () => new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
  scrollBy(0, at().y - innerHeight / 2);
  return [at().x, at().y];
})"""
BUTTON = """((name) => {
  const one = document.getElementById(name);
  one.scrollIntoView({ block: "center" });
  const box = one.getBoundingClientRect();
  return [box.x + box.width / 2, box.y + box.height / 2];
})"""


class User:
    """Somebody with a mouse in front of a report."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.clicks = 0

    def press(self, name: str) -> None:
        """Click a button."""
        self._click(self._page.evaluate(f'{BUTTON}("{name}")'))

    def point_at(self, place: DrawnPoint) -> None:
        """Click a place of the drawing, which is shown whole before if it isn't in view [m]."""
        for _ in range(2):
            at = self._page.evaluate(f"{PLACE}({list(place)})")
            if at is None:
                self.press("whole")
                at = self._page.evaluate(f"{PLACE}({list(place)})")
            self._click(at)
            if not self.said.startswith("Enlarged"):
                break

    def _click(self, at: Sequence[float]) -> None:
        self._page.click(*at)
        self.clicks += 1

    @property
    def said(self) -> str:
        """What the page says."""
        return str(self._page.evaluate('document.getElementById("said").textContent'))

    @property
    def question(self) -> tuple[DrawnPoint, DrawnPoint] | None:
        """The line that the page asks about [m]."""
        line = self._page.evaluate(QUESTION)
        return line and (tuple(line[0]), tuple(line[1]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps and their score.py")
    parser.add_argument("drawings", type=Path, help="their drawings by boundaries.py")
    arguments = parser.parse_args()
    score = scorer(arguments.rooms).score
    examples = prepared_examples(arguments.rooms)
    bad = [
        number
        for number, one in enumerate(examples)
        if not score(
            str(one.map.folder), str(arguments.drawings / f"{one.map.name}.json"), WIDEST_DOOR
        )["usable"]
    ]
    rows = []
    for number in bad[:: len(bad) // MAPS][:MAPS]:
        (kept,) = [kept for kept, left in folds(examples) if number in left]
        model = raise_constant(fit([examples[i] for i in kept]), RAISED)
        rows.append(corrected(examples[number].map, BoundaryModels(model, model, {}), score))
        print(rows[-1])
    title = "Drawings of real maps, corrected by clicks in a browser"
    print_and_save("drawing/clicks", title, rows, COLUMNS, MODULES)


def corrected(one: AnnotatedMap, models: BoundaryModels, score: Any) -> list[Any]:
    """A row of the table: a map's drawing before and after."""
    folder = Path(tempfile.mkdtemp())
    with mock.patch.object(BoundaryModels, "pretrained", return_value=models):
        before = make_drawing(one.grid, one.name, NETWORK)
        with Page(format_html(before), folder) as page:
            user = User(page)
            questions = answer_all(user, one)
            correct(user, one, before)
            user.press("save")
            saved = page.evaluate('document.getElementById("json").value')
        path = folder / "saved.json"
        path.write_text(saved, encoding="utf-8")
        after = make_drawing(one.grid, one.name, NETWORK, corrections=read_corrections(path))
    row: list[Any] = [one.name, one.set, questions, user.clicks]
    scores = []
    for drawing in (before, after):
        path.write_text(format_json(drawing), encoding="utf-8")
        scores.append(score(str(one.folder), str(path), WIDEST_DOOR))
    for key in ("f1", "usable"):
        row += [round(float(found[key]), 2) if key == "f1" else found[key] for found in scores]
    return row


def answer_all(user: User, one: AnnotatedMap) -> int:
    """Answer what the page asks; how many questions these were."""
    count = 0
    while user.question is not None:
        line = np.array(user.question)
        sides = sides_of(line, one)
        if 0 in sides or frozenset(sides) in one.pairs_by_taste:
            user.press("pass")
        else:
            user.press("yes" if len(set(sides)) > 1 else "no")
        count += 1
    return count


def correct(user: User, one: AnnotatedMap, drawing: Drawing) -> None:
    """Take boundaries away that are none, and add doors that lack."""
    told = [np.mean(question_line, axis=0) for question_line in lines_of(drawing.questions)]
    drawn = lines_of(drawing.doors)
    wrong = [line for line in drawn if is_within_room(line, one) and not is_near(line, told)]
    if wrong:
        user.press("join")
    for line in wrong:
        user.point_at(tuple(line.mean(axis=0).tolist()))
    certain, _ = one.boundaries()
    there = [*told, *(line.mean(axis=0) for line in drawn)]
    missing = [
        line
        for line in certain
        if np.hypot(*(line[1] - line[0])) <= WIDEST_DOOR
        and not is_near(line, there)
        and all(is_drawn(place, drawing) for place in beside(line))
    ]
    if missing:
        user.press("add_door")
    for line in missing:
        for end in line:
            user.point_at(tuple(end.tolist()))


def lines_of(segments: Sequence[Segment]) -> list[FloatArray]:
    """The ends of lines, (2, 2) each [m]."""
    return [np.array([one.start, one.end]) for one in segments]


def is_near(line: FloatArray, places: Sequence[FloatArray]) -> bool:
    """True if one of some places is near the middle of a line."""
    return any(np.hypot(*(line.mean(axis=0) - place)) <= SAME_PLACE for place in places)


def beside(line: FloatArray) -> FloatArray:
    """Places to both sides of a line, (2, 2) [m]."""
    along = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
    aside = BESIDE_LINE * np.array([-along[1], along[0]])
    return line.mean(axis=0) + np.stack([aside, -aside])


def sides_of(line: FloatArray, one: AnnotatedMap) -> list[int]:
    """Numbers of the rooms to both sides of a line, 0 for none."""
    return list(one.rooms_at(beside(line)).tolist())


def is_within_room(line: FloatArray, one: AnnotatedMap) -> bool:
    """True if a line parts nothing."""
    sides = sides_of(line, one)
    return sides[0] == sides[1] > 0


def is_drawn(place: FloatArray, drawing: Drawing) -> bool:
    """True if floor is drawn at a place."""
    return bool(drawing.floor.intersects(Point(place)))


if __name__ == "__main__":
    main()

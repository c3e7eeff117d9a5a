"""Fit what makes a line across the floor a boundary between two rooms: slamgym/drawing/pretrained/boundaries.json.

    python benchmarks/drawing/boundaries.py real_rooms -o out/rooms
    python benchmarks/drawing/real_rooms.py real_rooms network=out/rooms/slam2cad cleaning=out/rooms/none   # the table

The folder holds annotated maps, ``*/*/rooms.json`` and ``map.yaml``, and their ``score.py``. A logistic function of the
signs of all candidates is fitted to the maps whose licence allows it. Its constant is then raised to where the rooms
that are drawn are best: fitted to lines, it draws too few, for a boundary missed spoils two rooms, one too many splits
one. Over a wide range rooms are almost as good, so by how much is the mean of what is best for resampled buildings
(bagging), the same for both floor models. Every map of the output is drawn by what was fitted and chosen without its
building, in five folds; once more, ``MODEL-asked``, after the questions that its report asks were answered as the
annotation has it. Candidates and signs are kept in build/boundaries until the code changes.
"""

import argparse
import hashlib
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import average_precision_score, log_loss
from sklearn.model_selection import GroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import slamgym
from slamgym.core.types import BoolArray, FloatArray
from slamgym.drawing import FloorModel, load_floor_model
from slamgym.drawing.boundaries import PRETRAINED, BoundaryModel
from slamgym.drawing.candidates import Candidates, LikelyFloor
from slamgym.drawing.drawing import Question
from slamgym.drawing.edits import Correction, Corrections
from slamgym.drawing.floor import NO_MODEL, cleaned_floor
from slamgym.drawing.free_space import cross
from slamgym.drawing.openings import Division, Gap, joined_rooms
from slamgym.drawing.questions import doubtful_boundaries
from slamgym.drawing.revise import revise
from slamgym.drawing.signs import DOOR_SIGNS
from slamgym.drawing.vectorise import known_part
from slamgym.metrics.wall_direction import find_wall_direction

sys.path.insert(0, str(Path(__file__).parents[1]))
from annotated import WIDEST_DOOR, AnnotatedMap, read_annotated, scorer, write_division
from report import print_and_save

MODULES = ("slamgym/drawing",)
"""What is measured."""
ROOT = Path(__file__).parents[2]
FOLDS = 5
REGULARISATION = 0.03
"""Inverse strength, of standardised signs."""
RAISED = 0.3 * np.arange(7)
"""Constants that are tried, above the fitted one."""
RESAMPLES = 1000
"""Times that the buildings are drawn anew to raise the constant."""
BESIDE_LINE = 0.4
"""So far from a line one sees whether it parts two rooms [m]."""
NETWORK = "slam2cad"
MODELS = {NETWORK: "with_doors", NO_MODEL: "without_doors"}
"""Floor models, and whose weights each chooses."""
SOURCES = ("boundaries", "candidates", "flood", "floor", "free_space", "signs")
"""Modules of slamgym.drawing on which candidates and signs depend."""
COLUMNS = (
    "floor model",
    "maps",
    "number",
    "candidates",
    "boundaries",
    "found",
    "average precision",
    "log loss",
    "raised by",
)


@dataclass(frozen=True)
class Example:
    """A map, its candidates, and which of them are boundaries, or surely none."""

    map: AnnotatedMap
    candidates: Candidates
    is_boundary: BoolArray
    is_counted: BoolArray
    """False for lines beside a boundary, or at one that may be drawn or not."""
    found: int
    """True boundaries that are among the candidates."""
    boundaries: int


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rooms", type=Path, help="folder of annotated maps and their score.py")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for the drawings")
    arguments = parser.parse_args()
    rooms = Rooms(scorer(arguments.rooms))
    by_network = prepared_examples(arguments.rooms)
    by_cleaning = [without_network(one) for one in by_network]
    prepared = dict(zip(MODELS, (by_network, by_cleaning), strict=True))
    fitted = {name: crossed(examples) for name, examples in prepared.items()}
    f1 = np.mean([rooms_by_raise(prepared[name], fitted[name], rooms) for name in MODELS], axis=0)
    buildings = np.array([one.map.building for one in by_network])
    raised = raised_by(by_network, f1, buildings)
    shipped: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    for name, key in MODELS.items():
        examples = prepared[name]
        odds = [own + by for own, by in zip(fitted[name], raised, strict=True)]
        for one, own in zip(examples, odds, strict=True):
            likely = one.candidates.floor(own)
            division = drawn(likely, ())
            answers = answered(one.map, division, doubtful_boundaries(division, likely.others, ()))
            for made, folder in ((division, name), (drawn(likely, answers), f"{name}-asked")):
                write_division(made, arguments.output / folder / f"{one.map.name}.json")
        rows += figures(name, examples, odds, raised)
        shipped[key] = asdict(raise_constant(fit(examples), best_raise(f1, buildings)))
    shipped["about"] = about([one.map for one in by_network if one.map.may_be_used])
    PRETRAINED.write_text(json.dumps(shipped, indent=1) + "\n", encoding="utf-8")
    table = [[row[column] for column in COLUMNS] for row in rows]
    title = "Candidates for boundaries between rooms, judged without their buildings"
    print_and_save("drawing/boundaries", title, table, COLUMNS, MODULES)


def prepared_examples(folder: Path) -> list[Example]:
    """The annotated maps of a folder with candidates by the network, kept until the code changes."""
    prepare = joblib.Memory(ROOT / "build" / "boundaries", verbose=0).cache(
        example, ignore=["model"]
    )
    network = load_floor_model(NETWORK)
    digest = code_digest()
    return [prepare(one, digest, network) for one in read_annotated(folder)]


def about(used: Sequence[AnnotatedMap]) -> dict[str, Any]:
    """Where the weights come from."""
    sources = sorted({str(one.about["source_repo"]) for one in used})
    return {"maps": len(used), "sources": sources, "slamgym": slamgym.__version__}


def code_digest() -> str:
    """Changes with the code that finds candidates and signs."""
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((ROOT / "slamgym" / "drawing" / f"{name}.py").read_bytes())
    return digest.hexdigest()


def example(one: AnnotatedMap, digest: str, model: FloorModel) -> Example:  # noqa: ARG001 - part of the key
    """The candidates of a map, kept as long as the digest stays."""
    grid = known_part(one.grid)
    candidates = Candidates.of(grid, model, find_wall_direction(grid.cells).angle_deg)
    certain, optional = one.boundaries()
    matched, close = compared(candidates.lines, certain)
    is_boundary = np.any(matched, axis=1)
    near = np.hstack([close, compared(candidates.lines, optional)[1]])
    is_counted = is_boundary | ~np.any(near, axis=1)
    found = int(np.any(matched, axis=0).sum())
    return Example(one, candidates, is_boundary, is_counted, found, len(certain))


def without_network(one: Example) -> Example:
    """The same with the floor of cleaning alone: the candidates and what lies around them don't depend on a model."""
    found = one.candidates
    layers = cleaned_floor(found.grid, found.angle_deg)
    signs = {name: values for name, values in found.signs.items() if name not in DOOR_SIGNS}
    return replace(one, candidates=replace(found, layers=layers, signs=signs))


def compared(lines: FloatArray, true_lines: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which lines are which true ones, and which lie near them, both (N, M)."""
    (along, width), (true_along, true_width) = (directions(some) for some in (lines, true_lines))
    offset = lines.mean(axis=1)[:, None] - true_lines.mean(axis=1)[None]
    is_same = np.abs((offset * true_along).sum(axis=2)) <= np.maximum(0.2, 0.2 * true_width)
    is_same &= np.abs(cross(offset, true_along[None])) <= 0.3
    is_same &= np.abs(along @ true_along.T) > 0.9
    is_same &= np.abs(width[:, None] - true_width) < np.maximum(0.25, 0.3 * true_width)
    return is_same, np.hypot(*np.moveaxis(offset, 2, 0)) < np.maximum(0.5, 0.6 * true_width)


def directions(lines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (N, 2) and lengths (N,) of lines."""
    along = lines[:, 1] - lines[:, 0]
    width = np.maximum(np.hypot(*along.T), 1e-9)
    return along / width[:, None], width


def fit(examples: Sequence[Example]) -> BoundaryModel:
    """Constant and weights of the log odds, to the maps that may be used."""
    used = [one for one in examples if one.map.may_be_used]
    names = list(used[0].candidates.signs)
    signs = np.concatenate(
        [np.column_stack([one.candidates.signs[n] for n in names])[one.is_counted] for one in used]
    )
    is_boundary = np.concatenate([one.is_boundary[one.is_counted] for one in used])
    model = make_pipeline(StandardScaler(), LogisticRegression(C=REGULARISATION, max_iter=3000))
    model.fit(signs, is_boundary)
    scaler, logistic = model[0], model[1]
    weights = logistic.coef_[0] / scaler.scale_
    constant = float(logistic.intercept_[0] - weights @ scaler.mean_)
    return BoundaryModel(
        round(constant, 4), dict(zip(names, np.round(weights, 4).tolist(), strict=True))
    )


def raise_constant(model: BoundaryModel, by: float) -> BoundaryModel:
    return replace(model, constant=round(model.constant + by, 4))


def folds(examples: Sequence[Example]) -> list[tuple[list[int], list[int]]]:
    """Numbers of the maps to fit to and of those left out; a building is in one fold."""
    buildings = [one.map.building for one in examples]
    found = GroupKFold(FOLDS).split(buildings, groups=buildings)
    return [(kept.tolist(), left.tolist()) for kept, left in found]


def crossed(examples: Sequence[Example]) -> list[FloatArray]:
    """Log odds of all candidates by what was fitted without their fold."""
    odds: list[FloatArray] = [np.zeros(0)] * len(examples)
    for kept, left in folds(examples):
        model = fit([examples[i] for i in kept])
        for i in left:
            odds[i] = model.log_odds(examples[i].candidates.signs)
    return odds


def raised_by(examples: Sequence[Example], f1: FloatArray, buildings: np.ndarray) -> list[float]:
    """By how much the constant of each map is raised: as suits the rooms of the other folds, whose F1 is given."""
    raised = [0.0] * len(examples)
    for kept, left in folds(examples):
        for i in left:
            raised[i] = best_raise(f1[kept], buildings[kept])
    return raised


def rooms_by_raise(
    examples: Sequence[Example], odds: Sequence[FloatArray], rooms: "Rooms"
) -> FloatArray:
    """Room F1 of each map with each constant that is tried, (maps, constants)."""
    both = zip(examples, odds, strict=True)
    return np.array([[rooms.f1(one, own + by) for by in RAISED] for one, own in both])


def best_raise(f1: FloatArray, buildings: np.ndarray) -> float:
    """The mean of the best constants of resampled buildings, from F1 of (maps, constants) and each map's building.

    The best of all maps is a matter of chance: left out folds change it between 0 and 1.2.
    """
    names, of = np.unique(buildings, return_inverse=True)
    sums = np.zeros((len(names), len(RAISED) + 1))
    np.add.at(sums, of, np.column_stack([f1, np.ones(len(f1))]))
    shares = np.full(len(names), 1.0 / len(names))
    draws = np.random.default_rng(0).multinomial(len(names), shares, RESAMPLES) @ sums
    best = (draws[:, :-1] / draws[:, -1:]).argmax(axis=1)
    return round(float(RAISED[best].mean()), 2)


def drawn(likely: LikelyFloor, corrections: Sequence[Correction]) -> Division:
    """The rooms of a map as they are drawn."""
    return revise(likely.floor, likely.gaps, Corrections(tuple(corrections))).division


def answered(
    one: AnnotatedMap, division: Division, questions: Sequence[Question]
) -> list[Correction]:
    """What a person says who sees the rooms as the annotation has them; nothing where they are a matter of taste.

    A line that is drawn beside its place still parts the two rooms.
    """
    answers = []
    for question in questions:
        if question.is_drawn:
            gap = Gap(question.start, question.end)
            numbers = joined_rooms(division.rooms, [gap])[0].tolist()
            sides = [one.room_in(division.rooms[number]) for number in numbers]
        else:
            ends = np.array([question.start, question.end])
            along = (ends[1] - ends[0]) / question.length
            aside = BESIDE_LINE * np.array([-along[1], along[0]])
            sides = one.rooms_at(ends.mean(axis=0) + np.stack([aside, -aside])).tolist()
        if 0 not in sides and frozenset(sides) not in one.pairs_by_taste:
            kind = question.confirming if len(set(sides)) > 1 else "no_door"
            answers.append(Correction(kind, line=(question.start, question.end)))
    return answers


class Rooms:
    """The scorer of rooms."""

    def __init__(self, score: Any) -> None:
        self._score = score
        self._path = Path(tempfile.mkdtemp()) / "drawing.json"

    def f1(self, one: Example, odds: FloatArray) -> float:
        """Room F1 of what these log odds make of the seen space of a map."""
        write_division(one.candidates.division(odds), self._path)
        return float(self._score.score(str(one.map.folder), str(self._path), WIDEST_DOOR)["f1"])


def figures(
    name: str, examples: Sequence[Example], odds: Sequence[FloatArray], raised: Sequence[float]
) -> list[dict[str, Any]]:
    """Rows of the table, of all maps and of each set."""
    rows = []
    for maps in ("all", *sorted({one.map.set for one in examples})):
        chosen = [i for i, one in enumerate(examples) if maps in ("all", one.map.set)]
        some = [examples[i] for i in chosen]
        is_boundary = np.concatenate([one.is_boundary[one.is_counted] for one in some])
        log_odds = np.concatenate([odds[i][examples[i].is_counted] for i in chosen])
        probability = 1.0 / (1.0 + np.exp(-log_odds))
        values = (
            name,
            maps,
            len(some),
            len(is_boundary),
            sum(one.boundaries for one in some),
            sum(one.found for one in some),
            round(float(average_precision_score(is_boundary, probability)), 3),
            round(float(log_loss(is_boundary, probability)), 4),
            ", ".join(f"{by:g}" for by in sorted({raised[i] for i in chosen})),
        )
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


if __name__ == "__main__":
    main()

"""Table I by the paper's protocol: walls of 10 px of 256, and maps that needn't be complete.

Figures of Daher, Chakhachiro and Asmar, *From SLAM to CAD Maps and Back Using Generative Models*, Table I: 14 of 21
maps improved, mean MSE2 0.114 (0.028 to 0.339), mean MSE1 0.087.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from slamgym.commands.reproduce.own_claims import read_scores
from slamgym.commands.reproduce.steps import OWN_NETWORK, PAPER_NETWORK, TRAINED
from slamgym.commands.reproduce.verdicts import (
    Claim,
    counted_share,
    exact,
    intervals_of,
    judge,
    judge_error,
    with_interval,
)
from slamgym.core.intervals import mean_interval, wilson_interval
from slamgym.core.types import FREE, BoolArray, FloatArray
from slamgym.dataset.images.format import load_images, read_images
from slamgym.gan.evaluation.evaluate import RAW, THICKENED
from slamgym.metrics import free_space, squared_error

PAPER_MAPS = 21
"""Maps of the paper's Table I."""
PAPER_IMPROVED = 14
"""Those whose MSE1 is below their MSE2."""
PAPER_MSE2 = 0.114
"""Mean error of the paper's SLAM maps."""
PAPER_MSE2_RANGE = "0.028-0.339"
"""Least and largest error of the paper's SLAM maps."""
PAPER_MSE1 = 0.087
"""Mean error of the paper's translations."""
COVERAGES = (0.7, 0.8, 0.9, 0.95, 1.0)
"""Bounds of the classes of coverage; maps of less than the first are not rendered."""


class MapErrors(NamedTuple):
    """MSE2 of the SLAM maps by three alignments, and how complete they are."""

    coverage: FloatArray  # (N,) share of the reachable floor that was seen
    unaligned: FloatArray  # (N,)
    rigid: FloatArray  # (N,) after the best rigid motion
    similarity: FloatArray  # (N,) after the best similarity, as in the paper
    plans: list[str]
    """The plan of each map."""


def read_map_errors(images: Path, evaluation: Path) -> MapErrors:
    """Gather the errors of the SLAM maps.

    Args:
        images: Rendered by the protocol.
        evaluation: What ``slamgym gan evaluate`` made of their test side.

    Raises:
        InputFileError: If a file is missing or malformed.
    """
    scores = {row["name"]: row for row in read_scores(evaluation)[RAW]}
    records = [record for record in read_images(images, "test") if record.name in scores]
    unaligned = []
    for record in records:
        cad, slam = load_images(images, record)
        floor = np.asarray(cad > FREE // 2, dtype=np.float64)
        unaligned.append(squared_error(free_space(slam), floor))
    rigid = [float(scores[record.name]["mse_rigid"]) for record in records]
    similarity = [float(scores[record.name]["mse"]) for record in records]
    return MapErrors(
        coverage=np.array([record.coverage for record in records]),
        unaligned=np.array(unaligned),
        rigid=np.array(rigid),
        similarity=np.array(similarity),
        plans=[record.group for record in records],
    )


def alignment_table(errors: MapErrors) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: mean MSE2 by class of coverage, for each alignment."""
    rows = []
    for low, high in itertools.pairwise(COVERAGES):
        is_last = high == COVERAGES[-1]
        inside: BoolArray = (errors.coverage >= low) & ((errors.coverage < high) | is_last)
        if inside.any():
            rows.append(_alignment_row(f"{low:g} to {high:g}", errors, inside))
    everything = np.ones(len(errors.coverage), dtype=np.bool_)
    rows.append(_alignment_row("all", errors, everything))
    headings = ["coverage", "maps", "MSE2, not aligned", "rigid", "similarity", "least to largest"]
    return headings, rows


def _alignment_row(name: str, errors: MapErrors, chosen: BoolArray) -> list[str]:
    """A class of coverage."""
    plans = [plan for plan, is_chosen in zip(errors.plans, chosen, strict=True) if is_chosen]
    means = [
        with_interval(mean_interval(values[chosen], groups=plans), 3)
        for values in (errors.unaligned, errors.rigid, errors.similarity)
    ]
    aligned = errors.similarity[chosen]
    spread = f"{aligned.min():.3f}-{aligned.max():.3f}"
    return [name, str(len(plans)), *means, spread]


def table_one_beside(
    methods: Mapping[str, Any], errors: MapErrors
) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: the summary of the paper's Table I, then this run's.

    Args:
        methods: Those of ``evaluation.json``.
        errors: Of the SLAM maps.
    """
    paper = counted_share(wilson_interval(PAPER_IMPROVED, PAPER_MAPS), PAPER_MAPS)
    mse2 = f"{PAPER_MSE2:.3f} ({PAPER_MSE2_RANGE})"
    ratio = f"{PAPER_MSE1 / PAPER_MSE2:.2f}"
    rows = [
        ["the paper's Model32", str(PAPER_MAPS), mse2, f"{PAPER_MSE1:.3f}", ratio, paper, "-", "-"]
    ]
    own_range = f"{errors.similarity.min():.3f}-{errors.similarity.max():.3f}"
    raw = methods[RAW]
    raw_error = f"{raw['mse']['value']:.3f} ({own_range})"
    rows.append([RAW, str(raw["maps"]), raw_error, "-", "1", "-", *_walls_and_rooms(raw)])
    for name, entry in ((THICKENED, methods[THICKENED]), *_networks(methods)):
        found = intervals_of(entry["improvement"])
        row = [
            name,
            str(found["count"]),
            f"{found['mean_mse2'].value:.3f} ({own_range})",
            f"{found['mean_mse1'].value:.3f}",
            with_interval(found["ratio_of_means"]),
            counted_share(found["share_improved"], found["count"]),
            *_walls_and_rooms(entry),
        ]
        rows.append(row)
    headings = [
        "",
        "maps",
        "mean MSE2 (SLAM map)",
        "mean MSE1 (translation)",
        "MSE1 / MSE2",
        "improved",
        "wall F1 10 cm",
        "room count error",
    ]
    return headings, rows


def _walls_and_rooms(entry: Mapping[str, Any]) -> list[str]:
    """What thick walls can't buy."""
    found = intervals_of({name: entry[name] for name in ("wall_f1_10cm", "room_error")})
    return [with_interval(interval) for interval in found.values()]


def _networks(methods: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Translators from SLAM to CAD map."""
    names = (PAPER_NETWORK, OWN_NETWORK, TRAINED[PAPER_NETWORK], TRAINED[OWN_NETWORK])
    return ((name, methods[name]) for name in names if name in methods)


def table_one_claims(methods: Mapping[str, Any]) -> list[Claim]:
    """Table I and Figure 6.

    Args:
        methods: Those of ``evaluation.json``.
    """
    paper = wilson_interval(PAPER_IMPROVED, PAPER_MAPS)
    paper_ratio = PAPER_MSE1 / PAPER_MSE2
    claims = []
    for name, entry in _networks(methods):
        found = intervals_of(entry["improvement"])
        share = found["share_improved"]
        most = Claim(
            f"Table I: does {name} improve most maps?",
            counted_share(paper, PAPER_MAPS),
            counted_share(share, found["count"]),
            judge(share, paper, 0.5),
        )
        ratio = found["ratio_of_means"]
        lower = Claim(
            f"Table I: does {name} lower the error (MSE1 / MSE2)?",
            f"{paper_ratio:.2f}",
            with_interval(ratio),
            judge_error(ratio, exact(paper_ratio), 1.0),
        )
        claims += [most, lower]
    return claims

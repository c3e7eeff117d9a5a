"""``slamgym gan evaluate``: translators and baselines on held-out pairs, in tables and pictures."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro

from slamgym import __version__
from slamgym.commands.extras import Extra, require
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.progress import say, show_progress
from slamgym.core.staged import write_text
from slamgym.core.types import ByteArray
from slamgym.gan.config import REPEATS

if TYPE_CHECKING:
    from slamgym.gan.data import PairSet
    from slamgym.gan.evaluation.evaluate import MapScore, Method
    from slamgym.gan.evaluation.realism import Sample
    from slamgym.gan.translation.translate import Translator

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator


@dataclass(frozen=True)
class EvaluateArguments:
    """Measure translators on held-out pairs, beside the raw SLAM map, a cleaning without learning, and an oracle that
    erases all inner walls.

    Each method is aligned with the CAD map by the same search over similarities. OUT gets evaluation.json, scores.csv,
    tables.md and pictures. Weights that draw SLAM maps from CAD maps are judged by a two-sample test instead.
    """  # noqa: D205 - the first sentence is the help's heading

    images: tyro.conf.Positional[Path]
    """Folder of pairs that `slamgym dataset render` has written."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the results; made if it is missing, files of an earlier evaluation are replaced."""
    weights: list[str] = field(default_factory=list)
    """Translators: names of shipped weights, .safetensors files or folders of finished runs; NAME=PATH chooses the
    name in the tables. None measures the baselines alone."""
    flips: Literal[1, 2, 4, 8] | None = None
    """Average CAD maps over so many flips and quarter turns instead of what the weights' settings say."""
    split: str = "test"
    """Which pairs."""
    count: int = 0
    """Take so many pairs, evenly spaced over their names; 0 takes all."""
    size: int = 0
    """Side to which the images are resampled [px]; 0 leaves them as they are, 256 is the protocol's."""
    pictures: int = 20
    """Maps on the picture grids, evenly spaced; 0 draws none."""
    generated: list[str] = field(default_factory=list)
    """SLAM-like maps made from the test pairs' CAD maps, as NAME=FOLDER: judged against the simulated maps."""
    realism: bool = False
    """Judge elastic deformation against the simulated maps even if nothing else is given to be judged."""
    repeats: int = REPEATS
    """How often the two-sample tests deal plans to folds anew; fewer are faster and vary more."""
    cnn: bool = False
    """Let a convolutional network judge the pictures, too; takes minutes."""
    real: Path | None = None
    """A folder of ROS maps of real robots: draws their translations, for looking at."""
    device: Literal["auto", "cpu", "cuda", "mps"] = "cpu"
    """Where translators compute."""
    seed: int = 0
    """Of the two-sample tests and the elastic deformation."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code.

    Raises:
        SlamgymError: If something is wrong that the user can mend.
    """
    arguments = tyro.cli(EvaluateArguments, args=argv, prog="slamgym gan evaluate")
    from slamgym.gan.evaluation.evaluate import BLURRED
    from slamgym.gan.evaluation.generated_maps import MINIMUM, load_generated, parse_named_folders
    from slamgym.gan.evaluation.pictures import Results, write_pictures

    _check(arguments)
    if arguments.pictures:
        require(Extra("gan", ("matplotlib",)), "--pictures (or give --pictures 0)")
    folders = parse_named_folders(arguments.generated)
    translators = _load_translators(arguments)
    pairs = _load(arguments)
    to_cad = {name: t for name, t in translators.items() if t.config.direction == "slam2cad"}
    to_slam = {name: t for name, t in translators.items() if t.config.direction == "cad2slam"}
    generated = {name: load_generated(folder, pairs) for name, folder in folders.items()}
    judged = bool(generated or to_slam or arguments.realism)
    if judged:
        require(Extra("gan", ("sklearn",)), "a two-sample test")
    if judged and len(pairs) < MINIMUM:
        raise ConfigError(f"a two-sample test needs {MINIMUM} pairs or more, not {len(pairs)}")
    scores, summary = _measure(pairs, to_cad)
    _write(arguments, pairs, scores, summary, None)
    if arguments.pictures:
        # Blurred and then thresholded, the raw map looks as it did.
        shown = [method for method in _methods(to_cad) if method.name != BLURRED]
        write_pictures(arguments.out, Results(pairs, shown, scores), arguments.pictures)
    if arguments.real is not None:
        _draw_real(arguments, dict(to_cad))
    if judged:
        realism = _judge_realism(arguments, pairs, generated, to_slam)
        _write(arguments, pairs, scores, summary, realism)
    sys.stdout.write(f"results: {arguments.out}\n")
    return 0


def _check(arguments: EvaluateArguments) -> None:
    for name in ("count", "size", "pictures", "seed"):
        if getattr(arguments, name) < 0:
            raise ConfigError(f"--{name} must be 0 or more, not {getattr(arguments, name)}")
    if arguments.repeats < 1:
        raise ConfigError(f"--repeats must be 1 or more, not {arguments.repeats}")
    if 0 < arguments.size < 32:
        raise ConfigError(f"--size must be 32 px or more, not {arguments.size}")
    if arguments.real is not None and not arguments.real.is_dir():
        raise InputFileError(arguments.real, "is not a folder of ROS maps")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputFileError(arguments.out, "is a file; --out names a folder")


def _load_translators(arguments: EvaluateArguments) -> dict[str, LearnedTranslator]:
    """The translators by the name that tables show."""
    from slamgym.gan.evaluation.evaluate import baselines

    if not arguments.weights:
        return {}
    from slamgym.gan.translation.translate import load_translator

    translators: dict[str, LearnedTranslator] = {}
    for argument in arguments.weights:
        name, equals, path = argument.partition("=")
        if not equals:
            name, path = _short_name(argument), argument
        if name in translators or name in {method.name for method in baselines()}:
            raise ConfigError(f"two methods are called {name!r}; choose a name with --weights NAME=PATH")
        translator = load_translator(path, device=arguments.device)
        if arguments.flips is not None and translator.config.direction == "slam2cad":
            translator.config = dataclasses.replace(translator.config, flips=arguments.flips)
        translators[name] = translator
    return translators


def _short_name(argument: str) -> str:
    path = Path(argument)
    return path.parent.name if path.stem == "weights" and path.parent.name else path.stem


def _load(arguments: EvaluateArguments) -> PairSet:
    from slamgym.gan.data import load_pairs
    from slamgym.gan.evaluation.evaluate import evenly_spaced

    size = arguments.size or _native_size(arguments.images, arguments.split)
    pairs = load_pairs(arguments.images, arguments.split, size)
    if arguments.count:
        pairs = pairs.subset(evenly_spaced(len(pairs), arguments.count))
    return pairs


def _native_size(root: Path, split: str) -> int:
    """Side of the images of a folder [px]; 256 where there is none to ask, whose error comes with the pairs."""
    from slamgym.gan.data import read_grey

    folder = root / split / "A" if (root / split / "A").is_dir() else root / "A"
    first = next(iter(sorted(folder.glob("*.png"))), None) if folder.is_dir() else None
    return read_grey(first).shape[0] if first is not None else 256


def _methods(translators: dict[str, LearnedTranslator]) -> list[Method]:
    from slamgym.gan.evaluation.evaluate import baselines, learned

    return [*baselines(), *(learned(name, translator) for name, translator in translators.items())]


def _measure(
    pairs: PairSet, translators: dict[str, LearnedTranslator]
) -> tuple[dict[str, list[MapScore]], dict[str, dict[str, Any]]]:
    from slamgym.gan.evaluation.evaluate import evaluate_method
    from slamgym.gan.evaluation.summary import main_table, summarise

    methods = _methods(translators)
    scores = {}
    with show_progress("maps", 0, len(pairs) * len(methods)) as advance:
        for method in methods:
            scores[method.name] = evaluate_method(method, pairs, advance)
    summary = summarise(scores)
    _print(f"{len(pairs)} maps of {len(set(pairs.plan_ids))} plans, 95 % intervals", *main_table(summary))
    return scores, summary


def _judge_realism(
    arguments: EvaluateArguments,
    pairs: PairSet,
    generated: dict[str, tuple[PairSet, ByteArray]],
    translators: dict[str, LearnedTranslator],
) -> dict[str, Any]:
    from slamgym.gan.evaluation.pictures import write_generated_grid
    from slamgym.gan.evaluation.realism import (
        ELASTIC,
        NULL,
        Sample,
        elastic_maps,
        medians,
        null_halves,
        realism_table,
        translated_maps,
    )

    made = {ELASTIC: (pairs, elastic_maps(pairs, arguments.seed))} | generated
    for name, translator in translators.items():
        made |= translated_maps(name, translator, pairs, arguments.seed)
    reference = Sample.of(pairs.slam, pairs)
    # Simulated maps of all pairs, as each translator that draws fewer pixels brought them to its own resolution.
    coarse: dict[int, Sample] = {}
    entries, drawn = [], {}
    with show_progress("two-sample tests", 0, 1 + len(made)) as advance:
        first, second = (reference.subset(half) for half in null_halves(reference.plans, arguments.seed))
        entries.append(_judge(arguments, NULL, first, second))
        advance()
        for name, (some, maps) in made.items():
            chosen = [pairs.names.index(n) for n in some.names]
            if some.cad.shape[1] == pairs.cad.shape[1]:
                same = reference.subset(chosen)
            else:
                if id(some) not in coarse:
                    coarse[id(some)] = Sample.of(some.slam, some)
                same = coarse[id(some)]
            entries.append(_judge(arguments, name, same, Sample.of(maps, some)))
            drawn[name] = _spread(maps, chosen, len(pairs))
            advance()
    if arguments.pictures:
        write_generated_grid(arguments.out / "cad2slam.png", pairs, drawn, arguments.pictures)
    _print("Telling generated from simulated SLAM maps; 0.5 is perfect", *realism_table(entries))
    return {"reference_medians": medians(reference.statistics), "kinds": entries, "null": NULL}


def _judge(arguments: EvaluateArguments, name: str, reference: Sample, generated: Sample) -> dict[str, Any]:
    from slamgym.gan.evaluation.realism import judge

    return judge(name, reference, generated, arguments.seed, arguments.repeats, arguments.cnn)


def _spread(maps: ByteArray, chosen: Sequence[int], count: int) -> ByteArray:
    """Maps of some of the pairs at the places of all of them; empty where there is none."""
    spread = np.zeros((count, *maps.shape[1:]), np.uint8)
    spread[list(chosen)] = maps
    return spread


def _write(
    arguments: EvaluateArguments,
    pairs: PairSet,
    scores: dict[str, list[MapScore]],
    summary: dict[str, dict[str, Any]],
    realism: dict[str, Any] | None,
) -> None:
    from slamgym.gan.evaluation.realism import medians_table, realism_table
    from slamgym.gan.evaluation.summary import main_table, markdown, scores_csv, table_one

    low, middle, high = pairs.scale_percentiles() or (0.0, 0.0, 0.0)
    document = {
        "version": __version__,
        "images": arguments.images.name,
        "split": arguments.split,
        "maps": len(pairs),
        "plans": len(set(pairs.plan_ids)),
        "size_px": int(pairs.cad.shape[1]),
        "metres_per_px": {"p5": low, "p50": middle, "p95": high},
        "methods": summary,
        "realism": realism,
    }
    write_text(arguments.out / "evaluation.json", json.dumps(document, indent=1) + "\n")
    write_text(arguments.out / "scores.csv", scores_csv(scores))
    text = ["# Evaluation\n", markdown(*main_table(summary)), "## Table I\n", markdown(*table_one(scores))]
    if realism is not None:
        text += ["## CAD to SLAM\n", markdown(*realism_table(realism["kinds"]))]
        text += [markdown(*medians_table(realism["reference_medians"], realism["kinds"]))]
    write_text(arguments.out / "tables.md", "\n".join(text))


def _draw_real(arguments: EvaluateArguments, translators: dict[str, Translator]) -> None:
    from slamgym.gan.evaluation.real_maps import find_ros_maps, translate_real
    from slamgym.viz.figures import draw_grid, write_picture

    paths = find_ros_maps(arguments.real or Path())
    columns, rows, captions = translate_real(paths, translators, say)
    if rows:
        write_picture(arguments.out / "real_maps.png", draw_grid(columns, rows, captions))


def _print(title: str, headings: list[str], rows: list[list[str]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else 200).print(table)

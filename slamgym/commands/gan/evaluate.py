"""``slamgym gan evaluate``: translators and baselines on held-out pairs, in tables and pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym import __version__
from slamgym.commands.frame import show_table
from slamgym.commands.gan.arguments import EvaluateTranslatorsArguments
from slamgym.core.documents import json_text
from slamgym.core.errors import ConfigError
from slamgym.core.files import write_text
from slamgym.core.progress import counted, show_progress, tell
from slamgym.core.text import markdown
from slamgym.dataset.realism.comparison import (
    TREES,
    MapSet,
    RealismReport,
    compare_statistics,
    learn_by_trees,
    measure_map,
    require_enough,
)
from slamgym.dataset.realism.page import tests_table, to_json, to_markdown
from slamgym.gan.data import PairSet, face_lines, load_pairs
from slamgym.gan.evaluation.evaluate import (
    BLURRED,
    THICKENED,
    MapScore,
    TranslationMethod,
    baselines,
    evaluate_method,
    evenly_spaced,
    learned,
)
from slamgym.gan.evaluation.generated_maps import (
    GeneratedMaps,
    load_generated,
    parse_named_folders,
    translated_maps,
)
from slamgym.gan.evaluation.pictures import Results, write_generated_grid, write_pictures
from slamgym.gan.evaluation.summary import (
    dimensions_table,
    main_table,
    scores_csv,
    summarise_scores,
    table_one,
)
from slamgym.gan.pair_files import image_side
from slamgym.gan.translation.classical import wall_growth
from slamgym.gan.translation.translate import LearnedTranslator, load_translator

SIMULATED = "simulated"


def run_evaluation(arguments: EvaluateTranslatorsArguments) -> None:
    """Run the command.

    Raises:
        SlamgymError: If an argument, the images or the weights can't be used.
    """
    folders = parse_named_folders(arguments.generated)
    translators = _load_translators(arguments)
    size = arguments.size or image_side(arguments.images, arguments.split)
    pairs = load_pairs(arguments.images, arguments.split, size)
    if arguments.count:
        pairs = pairs.subset(evenly_spaced(len(pairs), arguments.count))
    to_cad = {name: t for name, t in translators.items() if t.config.direction == "slam2cad"}
    to_slam = {name: t for name, t in translators.items() if t.config.direction == "cad2slam"}
    generated = {name: load_generated(folder, pairs) for name, folder in folders.items()}
    tested = bool(generated or to_slam)
    if tested:
        require_enough(arguments.images, pairs.plan_ids)
    for name, maps in generated.items():
        require_enough(folders[name], [pairs.plan_ids[i] for i in maps])
    # What the paper's networks draw has the lines that they learnt, true faces get them here.
    lines = face_lines(arguments.images)
    added = {
        name: lines if t.config.output_encoding == "layers" else 0.0 for name, t in to_cad.items()
    }
    methods = [*baselines(), *(learned(name, t, added[name]) for name, t in to_cad.items())]
    scores, summary = _measure(pairs, methods)
    if arguments.pictures:
        # Blurred and then thresholded, the raw map looks as it did; with thick walls nearly so.
        shown = [method for method in methods if method.name not in (BLURRED, THICKENED)]
        write_pictures(arguments.out, Results(pairs, shown, scores), arguments.pictures)
    realism = _compare_realism(arguments, pairs, generated, to_slam) if tested else None
    _write(arguments, pairs, scores, summary, realism)
    tell(f"results: {arguments.out}")


def _load_translators(arguments: EvaluateTranslatorsArguments) -> dict[str, LearnedTranslator]:
    """The translators by the name that tables show."""
    translators: dict[str, LearnedTranslator] = {}
    for argument in arguments.weights:
        name, equals, path = argument.partition("=")
        if not equals:
            name = _short_name(argument)
            path = argument
        if name in translators or name in {method.name for method in baselines()}:
            raise ConfigError(
                f"two methods are called {name!r}; choose a name with --weights NAME=PATH"
            )
        translators[name] = load_translator(path, device=arguments.device)
    return translators


def _short_name(argument: str) -> str:
    path = Path(argument)
    return path.parent.name if path.stem == "weights" and path.parent.name else path.stem


def _measure(
    pairs: PairSet, methods: Sequence[TranslationMethod]
) -> tuple[dict[str, list[MapScore]], dict[str, dict[str, Any]]]:
    scores = {}
    with show_progress("maps", 0, len(pairs) * len(methods)) as advance:
        for method in methods:
            scores[method.name] = evaluate_method(method, pairs, advance)
    summary = summarise_scores(scores)
    title = f"{counted(len(pairs), 'map')} of {counted(len(set(pairs.plan_ids)), 'plan')}, 95 % intervals"
    show_table(*main_table(summary), title)
    show_table(*dimensions_table(summary), "Dimensions, after a rigid alignment")
    return scores, summary


def _compare_realism(
    arguments: EvaluateTranslatorsArguments,
    pairs: PairSet,
    generated: dict[str, GeneratedMaps],
    translators: dict[str, LearnedTranslator],
) -> RealismReport:
    """Compare each kind of generated maps with the simulated ones."""
    kinds = dict(generated)
    for name, translator in translators.items():
        kinds |= translated_maps(name, translator, pairs, arguments.seed)
    if arguments.pictures:
        write_generated_grid(arguments.out / "cad2slam.png", pairs, kinds, arguments.pictures)
    simulated = _map_set(SIMULATED, dict(enumerate(pairs.slam)), pairs)
    others = [_map_set(name, maps, pairs) for name, maps in kinds.items()]
    statistics = compare_statistics(simulated, others, arguments.seed)
    report = RealismReport(simulated, others, arguments.seed, statistics)
    with show_progress("two-sample tests", 0, len(report.sets)) as advance:
        for one in report.sets:
            report.test(TREES, learn_by_trees, simulated, one, arguments.repeats)
            advance()
    show_table(
        *tests_table(report), "Distinguishing generated from simulated SLAM maps; 0.5 is perfect"
    )
    return report


def _map_set(name: str, maps: GeneratedMaps, pairs: PairSet) -> MapSet:
    measured = [
        measure_map(pairs.names[i], pairs.plan_ids[i], cells, pairs.scale(i))
        for i, cells in maps.items()
    ]
    return MapSet(name, measured)


def _thickening(pairs: PairSet) -> str:
    """A sentence about what the row of thickened walls is."""
    growths = [wall_growth(pairs.cad[i], pairs.slam[i], pairs.scale(i)) for i in range(len(pairs))]
    low, middle, high = np.percentile(growths, [5.0, 50.0, 95.0])
    return (
        f"{THICKENED}: grown by {middle:.1f} px to each side ({low:.1f} to {high:.1f}), as thick as the CAD map's. It "
        "shows what thick walls alone gain: of the error, and of wall F1 where lines along the faces hide floor. Rooms "
        "can't be gained so.\n"
    )


def _write(
    arguments: EvaluateTranslatorsArguments,
    pairs: PairSet,
    scores: dict[str, list[MapScore]],
    summary: dict[str, dict[str, Any]],
    realism: RealismReport | None,
) -> None:
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
        "realism": None if realism is None else to_json(realism),
    }
    write_text(arguments.out / "evaluation.json", json_text(document))
    write_text(arguments.out / "scores.csv", scores_csv(scores))
    text = ["# Evaluation\n", markdown(*main_table(summary)), _thickening(pairs)]
    text += ["## Dimensions\n", markdown(*dimensions_table(summary))]
    text += ["## Table I\n", markdown(*table_one(scores))]
    if realism is not None:
        text += ["## CAD to SLAM\n", to_markdown(realism)]
    write_text(arguments.out / "tables.md", "\n".join(text))

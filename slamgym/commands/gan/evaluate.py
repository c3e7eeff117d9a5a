"""``slamgym gan evaluate``: translators and baselines on held-out pairs, in tables and pictures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamgym import __version__
from slamgym.commands.frame import as_text, show_table
from slamgym.commands.gan.arguments import EvaluateTranslatorsArguments
from slamgym.core.errors import ConfigError
from slamgym.core.files import write_text
from slamgym.core.progress import counted, say, show_progress, tell
from slamgym.core.text import markdown
from slamgym.core.types import ByteArray
from slamgym.gan.data import PairSet, image_side, load_pairs, true_faces
from slamgym.gan.evaluation.evaluate import (
    BLURRED,
    MapScore,
    TranslationMethod,
    baselines,
    evaluate_method,
    evenly_spaced,
    learned,
)
from slamgym.gan.evaluation.generated_maps import MINIMUM, Sample, load_generated, parse_named_folders
from slamgym.gan.evaluation.pictures import (
    Results,
    find_ros_maps,
    translate_real,
    write_generated_grid,
    write_pictures,
)
from slamgym.gan.evaluation.realism import (
    ELASTIC,
    NULL,
    compare_with_simulated,
    elastic_maps,
    medians,
    medians_table,
    null_halves,
    realism_table,
    translated_maps,
)
from slamgym.gan.evaluation.summary import (
    dimensions_table,
    main_table,
    scores_csv,
    summarise_scores,
    table_one,
)
from slamgym.gan.translation.translate import LearnedTranslator, load_translator
from slamgym.viz.canvas import write_picture
from slamgym.viz.sheets import draw_grid


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
    tested = bool(generated or to_slam or arguments.realism)
    if tested and len(pairs) < MINIMUM:
        raise ConfigError(f"a two-sample test needs {MINIMUM} pairs or more, not {len(pairs)}")
    scores, summary = _measure(pairs, to_cad)
    _write(arguments, pairs, scores, summary, None)
    if arguments.pictures:
        # Blurred and then thresholded, the raw map looks as it did.
        shown = [method for method in _methods(to_cad) if method.name != BLURRED]
        write_pictures(arguments.out, Results(pairs, shown, scores), arguments.pictures)
    if arguments.real is not None:
        columns, rows, captions = translate_real(find_ros_maps(arguments.real), dict(to_cad), say)
        if rows:
            write_picture(arguments.out / "real_maps.png", draw_grid(columns, rows, captions))
    if tested:
        realism = _compare_realism(arguments, pairs, generated, to_slam)
        _write(arguments, pairs, scores, summary, realism)
    tell(f"results: {arguments.out}")


def _load_translators(arguments: EvaluateTranslatorsArguments) -> dict[str, LearnedTranslator]:
    """The translators by the name that tables show."""
    translators: dict[str, LearnedTranslator] = {}
    for argument in arguments.weights:
        name, equals, path = argument.partition("=")
        if not equals:
            name, path = _short_name(argument), argument
        if name in translators or name in {method.name for method in baselines()}:
            raise ConfigError(f"two methods are called {name!r}; choose a name with --weights NAME=PATH")
        # Where the CAD maps have a line along every face, translations are compared with such faces, too.
        translators[name] = load_translator(
            path, device=arguments.device, flips=arguments.flips, true_faces=true_faces(arguments.images)
        )
    return translators


def _short_name(argument: str) -> str:
    path = Path(argument)
    return path.parent.name if path.stem == "weights" and path.parent.name else path.stem


def _methods(translators: dict[str, LearnedTranslator]) -> list[TranslationMethod]:
    return [*baselines(), *(learned(name, translator) for name, translator in translators.items())]


def _measure(
    pairs: PairSet, translators: dict[str, LearnedTranslator]
) -> tuple[dict[str, list[MapScore]], dict[str, dict[str, Any]]]:
    methods = _methods(translators)
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
    generated: dict[str, tuple[PairSet, ByteArray]],
    translators: dict[str, LearnedTranslator],
) -> dict[str, Any]:
    made = {ELASTIC: (pairs, elastic_maps(pairs, arguments.seed))} | generated
    for name, translator in translators.items():
        made |= translated_maps(name, translator, pairs, arguments.seed)

    def compare(name: str, simulated: Sample, other: Sample) -> dict[str, Any]:
        return compare_with_simulated(name, simulated, other, arguments.seed, arguments.repeats)

    reference = Sample.of(pairs.slam, pairs)
    # Simulated maps of all pairs, as each translator that draws fewer pixels brought them to its own resolution.
    coarse: dict[int, Sample] = {}
    entries, drawn = [], {}
    with show_progress("two-sample tests", 0, 1 + len(made)) as advance:
        first, second = (reference.subset(half) for half in null_halves(reference.plans, arguments.seed))
        entries.append(compare(NULL, first, second))
        advance()
        for name, (some, maps) in made.items():
            chosen = [pairs.names.index(n) for n in some.names]
            if some.cad.shape[1] == pairs.cad.shape[1]:
                same = reference.subset(chosen)
            else:
                if id(some) not in coarse:
                    coarse[id(some)] = Sample.of(some.slam, some)
                same = coarse[id(some)]
            entries.append(compare(name, same, Sample.of(maps, some)))
            drawn[name] = _spread(maps, chosen, len(pairs))
            advance()
    if arguments.pictures:
        write_generated_grid(arguments.out / "cad2slam.png", pairs, drawn, arguments.pictures)
    show_table(*realism_table(entries), "Distinguishing generated from simulated SLAM maps; 0.5 is perfect")
    return {"reference_medians": medians(reference.statistics), "kinds": entries, "null": NULL}


def _spread(maps: ByteArray, chosen: Sequence[int], count: int) -> ByteArray:
    """Maps of some of the pairs at the places of all of them; empty where there is none."""
    spread = np.zeros((count, *maps.shape[1:]), np.uint8)
    spread[list(chosen)] = maps
    return spread


def _write(
    arguments: EvaluateTranslatorsArguments,
    pairs: PairSet,
    scores: dict[str, list[MapScore]],
    summary: dict[str, dict[str, Any]],
    realism: dict[str, Any] | None,
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
        "realism": realism,
    }
    write_text(arguments.out / "evaluation.json", as_text(document))
    write_text(arguments.out / "scores.csv", scores_csv(scores))
    text = [
        "# Evaluation\n",
        markdown(*main_table(summary)),
        "## Dimensions\n",
        markdown(*dimensions_table(summary)),
    ]
    text += ["## Table I\n", markdown(*table_one(scores))]
    if realism is not None:
        text += ["## CAD to SLAM\n", markdown(*realism_table(realism["kinds"]))]
        text += [markdown(*medians_table(realism["reference_medians"], realism["kinds"]))]
    write_text(arguments.out / "tables.md", "\n".join(text))

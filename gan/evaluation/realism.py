"""Do generated SLAM maps look like simulated ones? For CAD to SLAM, which has no single right answer.

Each map becomes a list of statistics of its own and of where its walls lie against the CAD map it was made from (so
that a realistic map of another building is detected), and a classifier learns to distinguish generated from simulated
maps, cross-validated over plans: an accuracy of 0.5 is perfect. The same test between two sets of simulated maps shows
what the test makes of no difference.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgym.core.types import ByteArray
from slamgym.gan.data import PairSet
from slamgym.gan.evaluation.generated_maps import Sample, Statistics
from slamgym.gan.translation.elastic import bend
from slamgym.metrics.maps import resample_slam
from slamgym.metrics.two_sample import distinguish, ks_distance, tree_learner

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator

NULL, ELASTIC = "simulated, other maps", "elastic deformation"
SHOWN = (
    "share_unknown",
    "share_occupied",
    "wall_thickness_px",
    "open_border",
    "blobs_per_100m2",
    "holes_per_100m2",
    "displacement_p50_m",
    "displacement_p95_m",
    "missed_share",
    "displacement_correlation_1m",
)
"""Statistics whose medians are printed."""


def elastic_maps(pairs: PairSet, seed: int) -> ByteArray:
    """The baseline: CAD maps bent by random fields, (N, S, S)."""
    scales = pairs.metres_per_px
    return np.stack(
        [bend(pairs.cad[i], float(scales[i]), np.random.default_rng([seed, i])) for i in range(len(pairs))]
    )


def translated_maps(
    name: str, translator: "LearnedTranslator", pairs: PairSet, seed: int
) -> dict[str, tuple[PairSet, ByteArray]]:
    """What a translator makes of the CAD maps as they are, and of CAD maps bent as drift would.

    A network that works at less than the images' resolution is compared at its own, with the simulated maps brought to
    it, too: else the enlarged pixels alone would give it away.

    Args:
        name: Of the translator.
        translator: From CAD to SLAM.
        pairs: What to translate.
        seed: Of the bending.

    Returns:
        By name the pairs at that resolution and the maps (N, S, S).
    """
    side = min(pairs.cad.shape[1], translator.config.output_size)
    seen = pairs.resampled(translator.config.input_size)
    # In the same two steps as the targets of the training: each keeps walls that a single one would drop.
    coarse = seen.resampled(side)
    title = name if side == pairs.cad.shape[1] else f"{name} at {side} px"
    maps: dict[str, list[ByteArray]] = {title: [], f"{title}, bent": []}
    for i, (cad, scale) in enumerate(zip(seen.cad, seen.metres_per_px.tolist(), strict=True)):
        for drift, drawn in zip((None, np.random.default_rng([seed, i])), maps.values(), strict=True):
            drawn.append(resample_slam(translator.native_slam_map(cad, scale, drift), (side, side)))
    return {kind: (coarse, np.stack(drawn)) for kind, drawn in maps.items()}


def compare_with_simulated(
    name: str, reference: Sample, generated: Sample, seed: int = 0, repeats: int = 4
) -> dict[str, Any]:
    """Test one kind of maps against the simulated ones.

    Args:
        name: Of the kind.
        reference: Simulated maps.
        generated: The maps to compare with them.
        seed: Of the tests.
        repeats: How often plans are assigned to folds again; the accuracies are averaged.

    Returns:
        JSON form: ``name``, ``maps`` of each kind, the accuracy of the trees with its interval and the most telling
        statistics, and medians.
    """
    rows = [*reference.statistics, *generated.statistics]
    of_second = np.arange(len(rows)) >= len(reference.plans)
    plans = [*reference.plans, *generated.plans]
    found = distinguish(of_second, plans, tree_learner(rows), repeats=repeats, seed=seed).accuracy
    distances = [
        (
            key,
            ks_distance(
                [row[key] for row in reference.statistics], [row[key] for row in generated.statistics]
            ),
        )
        for key in rows[0]
    ]
    return {
        "name": name,
        "maps": len(generated.plans),
        "reference_maps": len(reference.plans),
        "extra_trees": {
            "accuracy": found.value,
            "low": found.low,
            "high": found.high,
            "telling": sorted(distances, key=lambda item: -item[1])[:5],
        },
        "medians": medians(generated.statistics),
    }


def null_halves(plan_ids: Sequence[str], seed: int) -> tuple[list[int], list[int]]:
    """Two sets of simulated maps between which there is nothing to find.

    Where plans were explored several times, one exploration and another; else half of the plans and the others.

    Returns:
        Their indices.
    """
    of_plan: dict[str, list[int]] = {}
    for index, plan in enumerate(plan_ids):
        of_plan.setdefault(plan, []).append(index)
    repeated = [indices for indices in of_plan.values() if len(indices) > 1]
    if len(repeated) * 2 >= len(of_plan):
        return [indices[0] for indices in repeated], [indices[1] for indices in repeated]
    dealt = np.random.default_rng(seed).permutation(sorted(of_plan))
    half = set(dealt[: len(dealt) // 2].tolist())
    first = [index for index, plan in enumerate(plan_ids) if plan in half]
    return first, [index for index, plan in enumerate(plan_ids) if plan not in half]


def medians(statistics: Statistics) -> dict[str, float]:
    """Medians of the statistics that are printed."""
    return {name: float(np.median([row[name] for row in statistics])) for name in SHOWN}


def realism_table(entries: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: how well each kind can be distinguished from simulated maps."""
    rows = []
    for entry in entries:
        found = entry["extra_trees"]
        accuracy = f"{found['accuracy']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"
        telling = ", ".join(f"{statistic} {distance:.2f}" for statistic, distance in found["telling"][:3])
        rows.append([entry["name"], str(entry["maps"]), accuracy, telling])
    return ["maps", "number", "accuracy, extra trees", "most telling statistics (KS distance)"], rows


def medians_table(
    reference: dict[str, float], entries: list[dict[str, Any]]
) -> tuple[list[str], list[list[str]]]:
    """Headings and rows: the medians of each kind beside those of simulated maps."""
    kinds = [entry for entry in entries if entry["name"] != NULL]
    rows = [
        [name, f"{reference[name]:.3g}", *(f"{entry['medians'][name]:.3g}" for entry in kinds)]
        for name in SHOWN
    ]
    return ["statistic", "simulated", *(entry["name"] for entry in kinds)], rows

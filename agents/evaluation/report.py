"""An evaluation as Markdown tables, figures as JSON and a plot of coverage over time, in the folder of the trials."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slamgym import __version__
from slamgym.agents.evaluation.evaluate import Evaluation, EvaluationConfig
from slamgym.agents.evaluation.summary import (
    DONE,
    SHARES,
    Comparison,
    ExplorerSummary,
    LevelComparison,
    Summary,
    summarise_trials,
)
from slamgym.agents.evaluation.trial import ORACLE, Trial
from slamgym.core.config import to_dict
from slamgym.core.documents import json_text
from slamgym.core.files import replace_file, storage_errors
from slamgym.core.intervals import Interval, mean_band
from slamgym.core.progress import counted
from slamgym.core.text import markdown
from slamgym.viz.plots import Curve, plot_curves

_RATIO_LEVELS = ("0.95", "0.99")
"""Shares of the floor at which explorers are set against the reference."""
_POINTS = 200
"""Points of a plotted curve."""


def describe_evaluation(summary: Summary) -> str:
    """All tables of an evaluation, as Markdown."""
    parts = [
        "Until the explorer is done with at least 98 % of the floor truly seen; a failure counts as the time limit, in "
        "ratios too, but for those where both succeed:\n",
        _done_table(summary),
        "Time to a share of the floor [s] / path driven by then [m], means over explorations; in brackets how many "
        "reached it [%]:\n",
        _levels_table(summary.explorers),
        "The whole exploration:\n",
        _whole_table(summary.explorers),
    ]
    if summary.comparisons:
        parts += [
            f"Time and path against `{summary.comparisons[0].reference}`, ratios of means with 95 % interval; below 1 "
            "is better; n: both reach the level:\n",
            _ratio_table(summary.comparisons),
        ]
    return "\n".join(parts)


def _done_table(summary: Summary) -> str:
    """The headline: success, time and path until done, and what of it comes after 99 % of the floor."""
    reference = summary.comparisons[0].reference if summary.comparisons else ""
    against = {comparison.explorer: comparison for comparison in summary.comparisons}
    header = [
        "explorer",
        "success [%]",
        "time until done [s]",
        "path until done [m]",
        "tail after 99 % [s]",
    ]
    if reference:
        header += [f"time / `{reference}`", f"path / `{reference}`", "time, both succeed"]
    rows = []
    for e in summary.explorers:
        cells = [
            f"`{e.explorer}`",
            f"{100 * e.success.value:.0f}",
            with_margin(e.time_to[DONE], 0),
            with_margin(e.path_to[DONE], 1),
            "-" if e.tail is None else with_margin(e.tail, 0),
        ]
        if e.explorer in against:
            compared = against[e.explorer]
            time = compared.time_to[DONE]
            cells += [with_bounds(time.ratio), with_bounds(compared.path_to[DONE].ratio)]
            cells.append(with_bounds(time.where_both))
        elif reference:
            cells += ["-", "-", "-"]
        rows.append(cells)
    return markdown(header, rows)


def _levels_table(explorers: Sequence[ExplorerSummary]) -> str:
    levels = SHARES[:-1]
    rows = []
    for e in explorers:
        cells = [f"`{e.explorer}`"]
        for level in levels:
            time = e.time_to[level].value
            path = e.path_to[level].value
            cells.append(f"{time:.0f} / {path:.1f} ({100 * e.reached[level]:.0f})")
        rows.append(cells)
    return markdown(["explorer", *map(_percent, levels)], rows)


def _percent(level: str) -> str:
    """A level as a heading says it."""
    return f"{100 * float(level):g} %"


def _whole_table(explorers: Sequence[ExplorerSummary]) -> str:
    header = [
        "explorer", "area under curve", "coverage [%]", "contacts",
        "map error [cm]", "ATE [cm]", "CPU a decision [ms]",
    ]  # fmt: skip
    # The oracle drives nowhere.
    rows = [
        [
            f"`{e.explorer}`",
            with_margin(e.mean_coverage, 3),
            f"{100 * e.coverage.value:.1f}",
            f"{e.collisions.value:.2f}",
            with_margin(e.map_error, 1, 100.0),
            with_margin(e.ate, 1, 100.0),
            f"{e.decision_ms:.1f}",
        ]
        for e in explorers
        if e.explorer != ORACLE
    ]
    return markdown(header, rows)


def _ratio_table(comparisons: Sequence[Comparison]) -> str:
    header = ["explorer"]
    header += [f"time to {_percent(level)}" for level in _RATIO_LEVELS]
    header += [f"path to {_percent(level)}" for level in _RATIO_LEVELS]
    rows = []
    for comparison in comparisons:
        cells = [f"`{comparison.explorer}`"]
        cells += [_ratio_cell(comparison.time_to[level]) for level in _RATIO_LEVELS]
        cells += [_ratio_cell(comparison.path_to[level]) for level in _RATIO_LEVELS]
        drives = comparison.explorer != ORACLE
        rows.append([*cells, with_bounds(comparison.map_error if drives else None)])
    return markdown([*header, "map error"], rows)


def _ratio_cell(found: LevelComparison) -> str:
    """A ratio, and in how many explorations both reach the level; a dash where there are none."""
    return f"{with_bounds(found.ratio)} n={found.both}" if found.both else "-"


def with_bounds(interval: Interval | None, digits: int = 2, factor: float = 1.0) -> str:
    """``0.85 [0.80, 0.91]``; a dash where there is none."""
    if interval is None:
        return "-"
    value = factor * interval.value
    low = factor * interval.low
    high = factor * interval.high
    return f"{value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def with_margin(interval: Interval, digits: int, factor: float = 1.0) -> str:
    """``2.3 ± 0.1``: half of the interval's width."""
    margin = 0.5 * factor * (interval.high - interval.low)
    return f"{factor * interval.value:.{digits}f} ± {margin:.{digits}f}"


def write_report(out: Path, evaluation: Evaluation, config: EvaluationConfig, against: str) -> str:
    """Write ``results.json`` and ``results.md``; returns the latter.

    Args:
        out: Folder of the evaluation.
        evaluation: Its trials.
        config: What was evaluated.
        against: The reference explorer.

    Raises:
        ConfigError: If the reference is not among the explorers.
        StorageError: If the folder can't be written.
    """
    summary = summarise_trials(evaluation.trials, against)
    text = _heading(summary, config, evaluation) + describe_evaluation(summary)
    document = {
        "version": __version__,
        "config": to_dict(config),
        "summary": dataclasses.asdict(summary),
        "skipped": [entry._asdict() for entry in evaluation.skipped],
        "failed": [dataclasses.asdict(entry) for entry in evaluation.failed],
    }
    with storage_errors(out):
        replace_file(out / "results.json", json_text(document).encode())
        replace_file(out / "results.md", text.encode())
    return text


def _heading(summary: Summary, config: EvaluationConfig, evaluation: Evaluation) -> str:
    lines = [
        f"{counted(summary.plans, 'plan')} (split {config.split or 'all'}, filter {config.plans_filter}), each "
        f"explored {counted(config.repetitions, 'time')} by every explorer; SLAM {config.trial.env.slam.mode}."
    ]
    if evaluation.skipped:
        lines.append(
            f"Skipped: {counted(len(evaluation.skipped), 'plan')} that the robot can't explore."
        )
    for name, count in Counter(trial.explorer for trial in evaluation.failed).items():
        failed = counted(count, "exploration")
        lines.append(
            f"Left out for all explorers: {failed} of `{name}` that crashed, hung or failed."
        )
    return "\n".join(lines) + "\n\n"


def draw_coverage(
    trials: Sequence[Trial], path: Path, title: str = "mean, with its 95 % interval"
) -> None:
    """Draw mean coverage over time with bands.

    Bands are 95 % bootstrap intervals of the mean over explorations. Time is robot time per floor area, so that
    plans of different sizes can be averaged; by its end nine of ten of the explorations that reach 99 % have.

    Args:
        trials: Of all explorers.
        path: PNG to write.
        title: Heading of the picture.

    Raises:
        SlamgymError: If matplotlib is not installed.
        InputFileError: If the picture can't be written.
    """
    reached = [trial.time_to["0.99"] for trial in trials]
    per_area = [
        time / trial.area for time, trial in zip(reached, trials, strict=True) if time is not None
    ]
    latest = np.percentile(per_area, 90.0) if per_area else 10.0
    times = np.linspace(0.0, latest, _POINTS)  # [s/m2]
    curves: list[Curve] = []
    for name in dict.fromkeys(trial.explorer for trial in trials):
        own = [trial for trial in trials if trial.explorer == name]
        found = np.vstack([trial.coverage_curve.at(times * trial.area) for trial in own])
        curves.append(Curve(f"{name} ({len(own)})", times, found.mean(axis=0), mean_band(found)))
    labels = ("robot time per floor area [s/m²]", "share of the reachable floor seen")
    plot_curves(path, curves, labels, title)

"""What an evaluation leaves in its folder beside the trials: tables, figures as JSON, a plot."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

from slamgym import __version__
from slamgym.agents.evaluation.evaluate import FULL_KNOWLEDGE, Evaluation, EvaluationConfig, Skipped
from slamgym.agents.evaluation.summary import Summary, summarise
from slamgym.agents.evaluation.tables import describe
from slamgym.core.config import to_dict
from slamgym.core.files import replace_file, storage_errors


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
    summary = summarise(evaluation.trials, against, yardstick=FULL_KNOWLEDGE)
    text = _heading(summary, config, evaluation.skipped) + describe(summary)
    with storage_errors(out):
        replace_file(out / "results.json", _as_json(summary, config, evaluation.skipped))
        replace_file(out / "results.md", text.encode())
    return text


def _heading(summary: Summary, config: EvaluationConfig, skipped: Sequence[Skipped]) -> str:
    lines = [
        f"{summary.plans} plans (split {config.split or 'all'}, filter {config.plans_filter}), each explored "
        f"{config.repetitions} time(s) by every explorer; SLAM {config.trial.env.slam.mode} with "
        f"{config.trial.env.slam.particles} particles."
    ]
    if skipped:
        lines.append(f"{len(skipped)} plan(s) were skipped: the robot can't explore them.")
    return "\n".join(lines) + "\n\n"


def _as_json(summary: Summary, config: EvaluationConfig, skipped: Sequence[Skipped]) -> bytes:
    document = {
        "version": __version__,
        "config": to_dict(config),
        "summary": dataclasses.asdict(summary),
        "skipped": [entry._asdict() for entry in skipped],
    }
    return json.dumps(document, indent=1).encode() + b"\n"

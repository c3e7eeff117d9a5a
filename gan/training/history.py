"""The losses of a training over its epochs: a log of lines in the run's folder, and the paper's Figure 4 of it."""

import importlib.util
import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import append_line, drop_torn_line, text_lines, write_text
from slamgym.viz.plots import plot_losses

LINES_PER_EPOCH = 10
"""So often the mean losses since the line before are noted."""
MIN_LINES = 2
"""Fewest lines that are drawn."""
_PLACE = ("step", "images", "epoch", "resolution", "total")
"""Numbers that every line has."""


class LossHistory:
    """Mean losses of the steps of a run, in ``losses.jsonl``: one line a tenth of an epoch."""

    def __init__(self, folder: Path, pairs: int, steps_done: int) -> None:
        """Take up the log of a run, or begin it.

        Lines of steps that the run will do again, because it was killed after its checkpoint, are dropped.

        Args:
            folder: Of the run.
            pairs: Training pairs: what one epoch is.
            steps_done: Steps that the checkpoint has done.

        Raises:
            InputFileError: If the log is damaged.
        """
        self._log = folder / "losses.jsonl"
        self._picture = folder / "losses.png"
        self._pairs = pairs
        self._sums: dict[str, float] = defaultdict(float)
        self._steps = 0
        self._place: dict[str, float] = {}
        self._lines = [line for line in self._noted() if line["step"] <= steps_done]
        self._images_noted = self._lines[-1]["images"] if self._lines else 0
        if self._log.exists():
            write_text(self._log, "".join(_as_text(line) for line in self._lines))

    def _noted(self) -> list[dict[str, Any]]:
        """The whole lines of the log."""
        drop_torn_line(self._log)
        if not self._log.exists():
            return []
        noted = []
        for text, where in text_lines(self._log):
            line = parse_json(text, where)
            if not isinstance(line, dict) or not all(_is_number(line.get(name)) for name in _PLACE):
                raise InputFileError(
                    where, "is no line of losses; delete the file to go on without it"
                )
            noted.append(line)
        return noted

    def add(self, terms: dict[str, float], step: int, images: int, resolution: int) -> None:
        """Take in a step.

        Args:
            terms: Its losses by name, as :meth:`slamgym.gan.training.learner.Learner.step` gives them.
            step: Its number.
            images: Pairs drawn up to its end.
            resolution: Side of what the generator drew [px].
        """
        if self._steps > 0 and resolution != self._place["resolution"]:
            self.note()
        for name, value in terms.items():
            self._sums[name] += value
        self._steps += 1
        epoch = round(images / self._pairs, 4)
        self._place = {"step": step, "images": images, "epoch": epoch, "resolution": resolution}
        if images - self._images_noted >= self._pairs / LINES_PER_EPOCH:
            self.note()

    def note(self) -> None:
        """Write down what was taken in since the last line: a kill shall lose nothing that a checkpoint has."""
        if self._steps == 0:
            return
        line: dict[str, Any] = self._place | {"steps": self._steps}
        for name, total in self._sums.items():
            line[name] = round(total / self._steps, 6)
        append_line(self._log, _as_text(line))
        self._lines.append(line)
        self._images_noted = line["images"]
        self._sums.clear()
        self._steps = 0

    def draw(self) -> None:
        """Draw ``losses.png``, as the paper's Figure 4: G, D, and where the resolution changes.

        Nothing is drawn before the second line, or without matplotlib.

        Raises:
            InputFileError: If it can't be written.
        """
        if len(self._lines) < MIN_LINES or importlib.util.find_spec("matplotlib") is None:
            return
        epochs = np.array([line["epoch"] for line in self._lines])
        panels = {"loss of G": np.array([line["total"] for line in self._lines])}
        judged = [name for name in self._lines[0] if name.startswith("discriminator_")]
        if judged:
            sums = [sum(line[name] for name in judged) for line in self._lines]
            panels["loss of D"] = np.array(sums)
        changes = {}
        for line, before in zip(self._lines[1:], self._lines, strict=False):
            if line["resolution"] != before["resolution"]:
                changes[before["epoch"]] = f"{line['resolution']} px"
        plot_losses(self._picture, epochs, panels, changes)


def _as_text(line: dict[str, Any]) -> str:
    return json.dumps(line) + "\n"


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)

"""What a training reports: a progress line, TensorBoard scalars, and sample images."""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TimeElapsedColumn

from slamgym.core.files import own_folder, write_bytes
from slamgym.core.pictures import encode_png
from slamgym.core.progress import LINE_INTERVAL, duration, say
from slamgym.core.types import ByteArray

LOSS_SMOOTHING = 0.98
"""Of the loss that is shown beside the bar."""


class TrainingLog:
    """Writes ``tensorboard/`` and ``samples/`` below a run's folder; use it as a context."""

    def __init__(self, folder: Path, first_step: int, enabled: bool = True) -> None:
        """Open the logs.

        Args:
            folder: Of the run.
            first_step: Where the training goes on; what an interrupted run logged beyond it is hidden.
            enabled: Whether to write TensorBoard files (they need the package ``tensorboard``).
        """
        self._samples = folder / "samples"
        self._writer: Any = None
        if enabled:
            self._writer = _open_writer(own_folder(folder / "tensorboard"), first_step)

    def __enter__(self) -> "TrainingLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.close()

    def scalars(self, group: str, values: Mapping[str, float], step: int) -> None:
        """Write values under ``group/``."""
        if self._writer is not None:
            for name, value in values.items():
                self._writer.add_scalar(f"{group}/{name}", value, step)

    def pictures(self, rows: ByteArray, step: int) -> None:
        """Write a grid of input, translation and target, one row each: (N, H, W) uint8."""
        grid = np.vstack(list(rows))
        write_bytes(own_folder(self._samples) / f"{step:07d}.png", encode_png(grid))
        if self._writer is not None:
            self._writer.add_image("samples", grid, step, dataformats="HW")


class Bar:
    """The progress of a training whose length may change."""

    def __init__(self, progress: Progress | None = None) -> None:
        self._began = self._last = time.monotonic()
        self._first: int | None = None
        self._loss: float | None = None
        self._progress = progress
        self._task = None if progress is None else progress.add_task("training", total=None, outlook="")

    def advance(self, images: int, total: int, loss: float, left: float | None = None) -> None:
        """Note how far the training is.

        Args:
            images: How many are done.
            total: How many there shall be.
            loss: Of the last step.
            left: Seconds to go, where the cost of the coming steps is known; None goes by the rate so far, which
                is wrong as soon as the stages differ.
        """
        if self._first is None:
            self._first, self._began = images, time.monotonic()
        self._loss = (
            loss if self._loss is None else LOSS_SMOOTHING * self._loss + (1.0 - LOSS_SMOOTHING) * loss
        )
        text = self._describe(images, total, left)
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, completed=images, total=total, outlook=text)
        elif time.monotonic() - self._last >= LINE_INTERVAL or images >= total:
            self._last = time.monotonic()
            say(f"{100.0 * images / total:.1f} % of {total:,} images, {text}")

    def _describe(self, images: int, total: int, left: float | None) -> str:
        assert self._first is not None
        fresh, seconds = images - self._first, time.monotonic() - self._began
        if fresh <= 0 or seconds <= 0.0:
            return f"loss {self._loss:.4g}"
        rate = fresh / seconds
        to_go = (total - images) / rate if left is None else left
        return f"loss {self._loss:.4g}, {rate:.3g} images/s, {duration(to_go)} left"


@contextmanager
def training_bar() -> Iterator[Bar]:
    """Show a bar on a terminal, a line now and then elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Bar()
        return
    columns = (
        "training",
        BarColumn(),
        "{task.percentage:.1f} %",
        TimeElapsedColumn(),
        "{task.fields[outlook]}",
    )
    with Progress(*columns, console=console) as progress:
        yield Bar(progress)


def _open_writer(folder: Path, first_step: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say("tensorboard isn't installed: no curves are written (pip install 'slamgym[gan]')")
        return None
    return SummaryWriter(str(folder), purge_step=first_step)

"""Arguments of the commands of ``slamgym gan``."""

from dataclasses import field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from slamgym.commands.frame import Out
from slamgym.commands.settings import AllSettings, SettingsOptions
from slamgym.core.config import Arguments, Count, CountOrZero, NonNegative, Positive, Seed, Within
from slamgym.core.errors import InputFileError
from slamgym.gan.config import DeviceName, Precision


class TrainTranslatorArguments(Arguments):
    """Train a translator between SLAM maps and CAD maps on rendered pairs.

    Ctrl-C and kill -9 lose at most the minutes since the last checkpoint: run the command again to resume, bit for
    bit on the same device.
    """

    images: tyro.conf.Positional[tuple[Path, ...]]
    """Folder of pairs: what `slamgym dataset render` writes, or any folder with A (CAD) and B (SLAM) images of equal
    names. Several are learned from together; plans on the test side of one train nothing from another."""
    out: Out
    """Folder of the run: settings, checkpoint, weights, samples, losses.png."""
    preset: str = "slam2cad"
    """slam2cad (the default translator), model32 and modelprog (the paper's), model32-cpu, modelprog-cpu."""
    minutes: Annotated[float, Within(gt=0.0, le=1e5)] | None = None
    """Wall-clock time for the whole training, which the stages share as they share the epochs. The CPU presets have
    some by default."""
    epochs: Positive | None = None
    """Passes over the data instead of the preset's; several stages are scaled alike."""
    batch_size: Count | None = None
    """Pairs a step, in all stages, instead of the preset's."""
    learning_rate: Positive | None = None
    """Instead of the preset's."""
    start_from: str | None = None
    """Train on from these weights instead of random ones: a pretrained name (slam2cad, ...), a .safetensors file, or a
    run's folder. By default at a tenth of the preset's rate, until five passes draw no better walls on held-out pairs;
    the best weights are kept."""
    seed: Seed | None = None
    """Seed of weights, order and augmentation; by default 0."""
    device: DeviceName = "auto"
    """``auto`` takes CUDA, else MPS, else the CPU."""
    precision: Precision = "auto"
    """``bfloat16`` mixes precisions; ``auto`` does where the hardware gains by it."""
    checkpoint_minutes: NonNegative = 2.0
    """Time between two checkpoints."""
    settings: AllSettings = SettingsOptions()
    """Networks, losses, stages and all else, on top of the preset."""


class TranslateArguments(Arguments):
    """Translate SLAM maps to CAD maps. The output lies over the input: same size, frame and scale.

    The way back, from a plan to SLAM maps, is `slamgym deform`.
    """

    input: Annotated[Path, tyro.conf.Positional]
    """An image (PNG, JPEG, BMP, PGM, TIFF), a ROS map's .yaml, or a folder of those."""
    out: Out
    """An image for an image; a folder or the stem of .pgm and .yaml for a ROS map; a folder for a folder."""
    weights: str = "slam2cad"
    """Pretrained weights by name, a .safetensors file, or the folder of a finished run."""
    metres_per_px: Annotated[float, Within(gt=0.0, lt=100.0)] | None = None
    """Scale of images [m/px]; ROS maps have their own. Without it an image is fitted into the network's image."""
    probability: bool = False
    """Write how likely each pixel is free (0 to 255) instead of a map of walls and floor (images only)."""
    straighten: bool = False
    """Turn the CAD map so that most walls lie along the axes, instead of laying it over the input (images only)."""
    device: DeviceName = "cpu"
    """Where to compute."""


class EvaluateTranslatorsArguments(Arguments):
    """Measure translators on held-out pairs, and the raw SLAM map, the same with thick walls, a cleaning without
    learning, and an oracle that erases all inner walls.

    Each method is aligned with the CAD map by the same search over similarities. OUT gets evaluation.json, scores.csv,
    tables.md and pictures. Weights that translate CAD maps to SLAM maps get a two-sample test instead.
    """  # noqa: D205 - the first sentence is the help's heading

    images: tyro.conf.Positional[Path]
    """Folder of pairs that `slamgym dataset render` has written."""
    out: Out
    """Folder for the results; made if it is missing, files of an earlier evaluation are replaced."""
    weights: list[str] = field(default_factory=list)
    """Translators: names of pretrained weights, .safetensors files or folders of finished runs; NAME=PATH chooses the
    name in the tables. None measures the baselines alone."""
    split: str = "test"
    """Which pairs."""
    count: CountOrZero = 0
    """Take so many pairs, evenly spaced over their names; 0 takes all."""
    size: Literal[0] | Annotated[int, Within(ge=32)] = 0
    """Side to which the images are resampled [px]; 0 keeps their size, 256 is the protocol's."""
    pictures: CountOrZero = 20
    """Maps on the picture grids, evenly spaced; 0 draws none."""
    generated: list[str] = field(default_factory=list)
    """SLAM-like maps made from the test pairs' CAD maps, as NAME=FOLDER: compared with the simulated maps."""
    repeats: Count = 4
    """Number of times that the two-sample tests deal plans to folds again; fewer are faster and vary more."""
    device: DeviceName = "cpu"
    """Where translators compute."""
    seed: CountOrZero = 0
    """Seed of the two-sample tests, and of the bending of CAD maps for translators to SLAM maps."""

    def _check(self) -> None:
        if self.out.exists() and not self.out.is_dir():
            raise InputFileError(self.out, "is a file; --out names a folder")

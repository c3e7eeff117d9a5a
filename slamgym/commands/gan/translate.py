"""``slamgym gan translate``: an image, a ROS map or a folder in; the same in the other kind of map out."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.progress import say, show_progress
from slamgym.core.staged import write_bytes
from slamgym.core.types import FREE, OCCUPIED, ByteArray, OccupancyGrid
from slamgym.gan.config import DeviceName

if TYPE_CHECKING:
    from slamgym.gan.translation.translate import LearnedTranslator

YAML = (".yaml", ".yml")


@dataclass(frozen=True)
class TranslateArguments:
    """Translate maps with trained weights. The output lies over the input: same size, frame and scale."""

    input: Annotated[Path, tyro.conf.Positional]
    """An image (PNG, JPEG, BMP, PGM, TIFF), a ROS map's .yaml, or a folder of those."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """An image for an image; a folder or the stem of .pgm and .yaml for a ROS map; a folder for a folder."""
    weights: str = "slam2cad"
    """Shipped weights by name, a .safetensors file, or the folder of a finished run."""
    metres_per_px: float | None = None
    """Scale of images [m/px]; ROS maps tell theirs. Without it an image is fitted into the network's image."""
    flips: int | None = None
    """Average over 1, 2, 4 or 8 flips and quarter turns: somewhat better, and as many times slower."""
    probability: bool = False
    """Write how likely each pixel is free (0 to 255) instead of a map of walls and floor (images only)."""
    straighten: bool = False
    """Turn the drawing so that most walls lie along the axes, instead of laying it over the input (images only)."""
    drift_seed: int | None = None
    """Bend CAD maps by a random field first, as drift would; each seed gives another SLAM map of the same building."""
    device: DeviceName = "cpu"
    """Where to compute."""


def main(argv: list[str]) -> int:
    """Run the command; returns the exit code."""
    arguments = tyro.cli(TranslateArguments, args=argv, prog="slamgym gan translate")
    from slamgym.gan.translation.translate import load_translator

    scale = arguments.metres_per_px
    if scale is not None and not 0.0 < scale < 100.0:
        raise ConfigError(f"--metres-per-px must be positive, not {scale}")
    if not arguments.input.exists():
        raise InputFileError(arguments.input, "doesn't exist; give an image, a ROS map's yaml or a folder")
    translator = load_translator(arguments.weights, device=arguments.device, flips=arguments.flips)
    if arguments.probability and translator.config.direction != "slam2cad":
        raise ConfigError("--probability needs weights that translate SLAM maps to CAD maps")
    if arguments.drift_seed is not None and translator.config.direction != "cad2slam":
        raise ConfigError("--drift-seed needs weights that translate CAD maps to SLAM maps")
    if arguments.input.is_dir():
        _translate_folder(arguments, translator)
    elif arguments.input.suffix.lower() in YAML:
        sys.stdout.write(f"{translate_ros_map(arguments.input, arguments.out, translator, arguments)}\n")
    else:
        out = _image_destination(arguments.out, arguments.input)
        translate_image(arguments.input, out, translator, arguments)
        sys.stdout.write(f"{out}\n")
    return 0


def translate_ros_map(
    source: Path, out: Path, translator: LearnedTranslator, arguments: TranslateArguments
) -> Path:
    """Translate a ROS map; returns the yaml file written.

    Args:
        source: The yaml file.
        out: Folder, or stem of the two files.
        translator: What translates.
        arguments: How it is drawn.
    """
    from slamgym.interop.ros_map import read_ros_map, write_ros_map

    grid = read_ros_map(source)
    cells = translator.translate_cells(
        _as_input(grid.cells, translator, ternary=True), grid.frame.resolution, drift=_drift(arguments)
    )
    stem = out / source.stem if out.is_dir() else out.with_suffix("") if out.suffix in YAML else out
    return write_ros_map(stem, OccupancyGrid(cells, grid.frame))


def translate_image(
    source: Path,
    out: Path,
    translator: LearnedTranslator,
    arguments: TranslateArguments,
) -> None:
    """Translate an image file and write another.

    Args:
        source: Grey image; for SLAM maps its greys are classified as ROS maps' are.
        out: Image to write; its suffix tells the format.
        translator: What translates.
        arguments: Scale, and what to write.
    """
    import cv2

    from slamgym.gan.data import read_grey

    cells = _as_input(read_grey(source), translator)
    scale, straighten = arguments.metres_per_px, arguments.straighten
    if arguments.probability:
        image = np.rint(255.0 * translator.translate(cells, scale, straighten)).astype(np.uint8)
    else:
        image = translator.translate_cells(cells, scale, straighten, _drift(arguments))
    written, data = cv2.imencode(out.suffix or ".png", image)
    if not written:
        raise InputFileError(out, "can't be written in this format; choose .png")
    write_bytes(out, data.tobytes())


def _drift(arguments: TranslateArguments) -> np.random.Generator | None:
    return None if arguments.drift_seed is None else np.random.default_rng(arguments.drift_seed)


def _as_input(grey: ByteArray, translator: LearnedTranslator, ternary: bool = False) -> ByteArray:
    from slamgym.interop.ros_map import classify

    if translator.config.direction == "slam2cad":
        return grey if ternary else classify(grey)
    # In a CAD map all that isn't white is wall or outside.
    return np.where(grey > FREE // 2, FREE, OCCUPIED).astype(np.uint8) if not ternary else _floor(grey)


def _floor(cells: ByteArray) -> ByteArray:
    return np.where(cells == FREE, FREE, OCCUPIED).astype(np.uint8)


def _image_destination(out: Path, source: Path) -> Path:
    from slamgym.gan.data import SUFFIXES

    if out.is_dir():
        return out / f"{source.stem}.png"
    if out.suffix.lower() not in SUFFIXES:
        raise InputFileError(out, f"is no image name; end it in one of {', '.join(SUFFIXES)}")
    return out


def _translate_folder(arguments: TranslateArguments, translator: LearnedTranslator) -> None:
    from slamgym.gan.data import SUFFIXES

    files = sorted(arguments.input.iterdir())
    maps = [path for path in files if path.suffix.lower() in YAML]
    belonging = {path.stem for path in maps}
    images = [path for path in files if path.suffix.lower() in SUFFIXES and path.stem not in belonging]
    if not maps and not images:
        raise InputFileError(arguments.input, f"holds no images ({', '.join(SUFFIXES)}) and no ROS maps")
    if arguments.out.is_file():
        raise InputFileError(arguments.out, "is a file; a folder is translated into a folder")
    arguments.out.mkdir(parents=True, exist_ok=True)
    refused = 0
    with show_progress("maps", 0, len(maps) + len(images)) as advance:
        for path in [*maps, *images]:
            try:
                if path in maps:
                    translate_ros_map(path, arguments.out / path.stem, translator, arguments)
                else:
                    out = arguments.out / f"{path.stem}.png"
                    translate_image(path, out, translator, arguments)
            except InputFileError as error:
                refused += 1
                say(f"skipped {error}")
            advance()
    if refused == len(maps) + len(images):
        raise InputFileError(arguments.input, "holds nothing that could be translated; see the lines above")
    sys.stdout.write(f"{len(maps) + len(images) - refused} maps in {arguments.out}\n")

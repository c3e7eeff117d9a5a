"""``slamgym gan translate``: SLAM maps in (an image, a ROS map or a folder); CAD maps out."""

from pathlib import Path

import cv2
import numpy as np

from slamgym.commands.frame import maps_in, require_folder, require_input
from slamgym.commands.gan.arguments import TranslateArguments
from slamgym.core.documents import YAML_SUFFIXES
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import spare_inputs, write_bytes
from slamgym.core.names import distinct_names
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.progress import counted, say, show_progress, tell
from slamgym.core.types import OccupancyGrid
from slamgym.gan.pair_files import read_grey
from slamgym.gan.translation.translate import LearnedTranslator, load_translator
from slamgym.interop.ros_map import classify_greys, described_picture, read_ros_map, write_ros_map


def run_translation(arguments: TranslateArguments) -> None:
    """Run the command.

    Raises:
        SlamgymError: If an argument, the weights or the input can't be used.
    """
    source = arguments.input
    out = arguments.out
    require_input(source, "an image, a ROS map's yaml or a folder")
    translator = load_translator(arguments.weights, device=arguments.device)
    if translator.config.direction != "slam2cad":
        raise ConfigError(
            f"{arguments.weights} translates CAD maps to SLAM maps; use `slamgym deform PLAN --method modelprog "
            f"--weights {arguments.weights}`"
        )
    output = translator.config.output_size
    whole = translator.config.input_size
    if output < whole:
        say(
            f"{arguments.weights} draws {output} pixels for {whole} of its input: outlines and long walls, no short "
            "ones. It repeats the paper's experiment; for drawings take slam2cad, or `slamgym cad`."
        )
    if source.is_dir():
        _translate_folder(arguments, translator)
        return
    if out.is_dir():
        out = out / f"{source.stem}.png"
    elif not _is_ros_map(source) and out.suffix.lower() not in PICTURE_SUFFIXES:
        raise InputFileError(
            out, f"is no image name; end it in one of {', '.join(PICTURE_SUFFIXES)}"
        )
    tell(f"{_translate(source, out, translator, arguments)}")


def _translate_folder(arguments: TranslateArguments, translator: LearnedTranslator) -> None:
    what = f"images ({', '.join(PICTURE_SUFFIXES)})"
    maps = maps_in(arguments.input, lambda path: path.suffix.lower() in PICTURE_SUFFIXES, what)
    require_folder(arguments.out)
    arguments.out.mkdir(parents=True, exist_ok=True)
    refused = 0
    with show_progress("maps", 0, len(maps)) as advance:
        for name, path in zip(distinct_names(maps), maps, strict=True):
            try:
                _translate(path, arguments.out / f"{name}.png", translator, arguments)
            except InputFileError as error:
                refused += 1
                say(f"skipped {error}")
            advance()
    if refused == len(maps):
        raise InputFileError(
            arguments.input, "holds nothing that could be translated; see the lines above"
        )
    tell(f"{counted(len(maps) - refused, 'map')} in {arguments.out}")


def _is_ros_map(path: Path) -> bool:
    return path.suffix.lower() in YAML_SUFFIXES


def _translate(
    source: Path, out: Path, translator: LearnedTranslator, arguments: TranslateArguments
) -> Path:
    """Translate a ROS map or an image, whose greys are classified as ROS maps' are; returns what was written."""
    if _is_ros_map(source):
        stem = out.with_suffix("") if out.suffix in (".png", *YAML_SUFFIXES) else out
        for suffix in (".yaml", ".pgm"):
            spare_inputs([source, described_picture(source)], stem.with_name(stem.name + suffix))
        grid = read_ros_map(source)
        cells = translator.translate_cells(grid.cells, grid.frame.resolution)
        return write_ros_map(stem, OccupancyGrid(cells, grid.frame))
    spare_inputs([source], out)
    cells = classify_greys(read_grey(source))
    scale = arguments.metres_per_px
    straighten = arguments.straighten
    if arguments.probability:
        image = np.rint(255.0 * translator.translate(cells, scale, straighten)).astype(np.uint8)
    else:
        image = translator.translate_cells(cells, scale, straighten)
    written, data = cv2.imencode(out.suffix or ".png", image)
    if not written:
        raise InputFileError(out, "can't be written in this format; choose .png")
    write_bytes(out, data.tobytes())
    return out

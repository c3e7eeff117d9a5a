"""``slamgym gan translate``: SLAM maps in (an image, a ROS map or a folder); CAD maps out."""

from pathlib import Path

import cv2
import numpy as np

from slamgym.commands.gan.arguments import TranslateArguments
from slamgym.core.documents import YAML_SUFFIXES
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import spare_inputs, write_bytes
from slamgym.core.names import distinct_names
from slamgym.core.progress import counted, say, show_progress, tell
from slamgym.core.types import OccupancyGrid
from slamgym.gan.data import SUFFIXES, read_grey
from slamgym.gan.translation.translate import LearnedTranslator, load_translator
from slamgym.interop.ros_map import classify_greys, described_picture, read_ros_map, write_ros_map


def run_translation(arguments: TranslateArguments) -> int:
    """Run the command; returns the exit code.

    Raises:
        SlamgymError: If an argument, the weights or the input can't be used.
    """
    scale = arguments.metres_per_px
    if scale is not None and not 0.0 < scale < 100.0:
        raise ConfigError(f"--metres-per-px must be positive, not {scale}")
    if not arguments.input.exists():
        raise InputFileError(arguments.input, "doesn't exist; give an image, a ROS map's yaml or a folder")
    translator = load_translator(arguments.weights, device=arguments.device, flips=arguments.flips)
    if translator.config.direction != "slam2cad":
        raise ConfigError(
            f"{arguments.weights} translates CAD maps to SLAM maps; use `slamgym deform PLAN --method modelprog "
            f"--weights {arguments.weights}`"
        )
    output, whole = translator.config.output_size, translator.config.input_size
    if output < whole:
        say(
            f"{arguments.weights} draws {output} pixels for {whole} of its input: outlines and long walls, no short "
            "ones. It repeats the paper's experiment; for drawings take slam2cad, or `slamgym cad`."
        )
    if arguments.input.is_dir():
        _translate_folder(arguments, translator)
    elif arguments.input.suffix.lower() in YAML_SUFFIXES:
        out = arguments.out
        stem = (
            out / arguments.input.stem
            if out.is_dir()
            else out.with_suffix("")
            if out.suffix in YAML_SUFFIXES
            else out
        )
        tell(f"{translate_ros_map(arguments.input, stem, translator)}")
    else:
        out = _image_destination(arguments.out, arguments.input)
        translate_image(arguments.input, out, translator, arguments)
        tell(f"{out}")
    return 0


def translate_ros_map(source: Path, stem: Path, translator: LearnedTranslator) -> Path:
    """Translate a ROS map; returns the yaml file written.

    Args:
        source: The yaml file.
        stem: Of the two files to write.
        translator: What translates.
    """
    for suffix in (".yaml", ".pgm"):
        spare_inputs([source, described_picture(source)], stem.with_name(stem.name + suffix))
    grid = read_ros_map(source)
    cells = translator.translate_cells(grid.cells, grid.frame.resolution)
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
        out: Image to write; its suffix gives the format.
        translator: What translates.
        arguments: Scale, and what to write.
    """
    spare_inputs([source], out)
    cells = classify_greys(read_grey(source))
    scale, straighten = arguments.metres_per_px, arguments.straighten
    if arguments.probability:
        image = np.rint(255.0 * translator.translate(cells, scale, straighten)).astype(np.uint8)
    else:
        image = translator.translate_cells(cells, scale, straighten)
    written, data = cv2.imencode(out.suffix or ".png", image)
    if not written:
        raise InputFileError(out, "can't be written in this format; choose .png")
    write_bytes(out, data.tobytes())


def _image_destination(out: Path, source: Path) -> Path:
    if out.is_dir():
        return out / f"{source.stem}.png"
    if out.suffix.lower() not in SUFFIXES:
        raise InputFileError(out, f"is no image name; end it in one of {', '.join(SUFFIXES)}")
    return out


def _translate_folder(arguments: TranslateArguments, translator: LearnedTranslator) -> None:
    # A name like "..yaml" would lead out of the output folder.
    files = [path for path in sorted(arguments.input.iterdir()) if not path.name.startswith(".")]
    maps = [path for path in files if path.suffix.lower() in YAML_SUFFIXES]
    belonging = {path.stem for path in maps}
    images = [path for path in files if path.suffix.lower() in SUFFIXES and path.stem not in belonging]
    if not maps and not images:
        raise InputFileError(arguments.input, f"holds no images ({', '.join(SUFFIXES)}) and no ROS maps")
    if arguments.out.is_file():
        raise InputFileError(arguments.out, "is a file; a folder is translated into a folder")
    named = zip(distinct_names([*maps, *images]), [*maps, *images], strict=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    refused = 0
    with show_progress("maps", 0, len(maps) + len(images)) as advance:
        for name, path in named:
            try:
                if path in maps:
                    translate_ros_map(path, arguments.out / name, translator)
                else:
                    translate_image(path, arguments.out / f"{name}.png", translator, arguments)
            except InputFileError as error:
                refused += 1
                say(f"skipped {error}")
            advance()
    if refused == len(maps) + len(images):
        raise InputFileError(arguments.input, "holds nothing that could be translated; see the lines above")
    tell(f"{counted(len(maps) + len(images) - refused, 'map')} in {arguments.out}")

"""One function for all formats."""

from collections.abc import Callable, Sequence
from pathlib import Path

from slamgym.core.errors import InputFileError, SlamgymError
from slamgym.core.files import write_text
from slamgym.drawing.drawing import Drawing
from slamgym.drawing.formats.names import DRAWING_FORMATS


def write_drawing(drawing: Drawing, stem: Path | str, formats: Sequence[str]) -> list[Path]:
    """Write a drawing in several formats.

    Args:
        drawing: What to write.
        stem: Of the files: ``out/flat`` for ``out/flat.dxf``.
        formats: Out of :data:`~slamgym.drawing.formats.names.DRAWING_FORMATS`.

    Returns:
        The files, in the order of the formats.

    Raises:
        SlamgymError: If a file can't be written, or a format is unknown or needs a package that isn't installed.
    """
    writers: dict[str, Callable[[Path, Drawing], None]] = {
        "svg": _write_svg,
        "geojson": _write_geojson,
        "json": _write_json,
        "png": _write_png,
        "dxf": _write_dxf,
        "ifc": _write_ifc,
        "html": _write_html,
        "yaml": _write_ros_map,
    }
    unknown = [name for name in formats if name not in writers]
    if unknown:
        raise SlamgymError(f"unknown format {unknown[0]!r}; choose from {', '.join(DRAWING_FORMATS)}")
    stem, paths = Path(stem), []
    for name in dict.fromkeys(formats):
        path = stem.with_name(f"{stem.name}.{name}")
        writers[name](path, drawing)
        paths.append(path)
    return paths


def _write_svg(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.svg import format_svg

    write_text(path, format_svg(drawing))


def _write_geojson(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.geojson import format_geojson

    write_text(path, format_geojson(drawing))


def _write_json(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.houseexpo_json import format_json

    write_text(path, format_json(drawing))


def _write_png(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.png import draw_picture
    from slamgym.viz.canvas import write_picture

    write_picture(path, draw_picture(drawing))


def _write_dxf(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.dxf import write_dxf

    write_dxf(path, drawing)


def _write_ifc(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.ifc import write_ifc

    write_ifc(path, drawing)


def _write_html(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.report.page import format_html

    write_text(path, format_html(drawing))


def _write_ros_map(path: Path, drawing: Drawing) -> None:
    from slamgym.drawing.formats.ros_map import drawing_map
    from slamgym.interop.ros_map import write_ros_map

    stem = path.with_suffix("")
    if stem.is_dir():
        raise InputFileError(stem, "is a folder, into which the ROS map would be written; name another --out")
    write_ros_map(stem, drawing_map(drawing))

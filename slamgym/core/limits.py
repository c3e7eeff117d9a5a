"""Limits of what is read from outside, so that a hostile or damaged file costs a sentence and not the machine.

Each limit is far above all good data that we know of (docs/limits.md has the table) and is read from its environment
variable whenever it is needed; the sentence that refuses a file names the variable.
"""

import os
import reprlib
from typing import Any, NamedTuple

from slamgym.core.errors import ConfigError, InputFileError

MAX_SHOWN = 80
"""A value from a file takes at most so many characters in a message."""


class Limit(NamedTuple):
    """The most of something that a file may hold."""

    variable: str
    """The environment variable that sets it."""
    default: int
    unit: str
    """Name of the thing that is counted, as in ``has 7 pixels``."""
    of: str
    """The files that it limits, for the documentation."""

    @property
    def value(self) -> int:
        """The limit in force.

        Raises:
            ConfigError: If the variable isn't a whole number above 0.
        """
        text = os.environ.get(self.variable, "")
        if not text:
            return self.default
        if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) > 0):
            raise ConfigError(f"{self.variable} must be a whole number above 0, not {shown(text)}")
        return int(text)

    def check(
        self, where: object, count: float, error: type[InputFileError] = InputFileError
    ) -> None:
        """Refuse a file that holds more.

        Args:
            where: The file, or the place in it, that the error names.
            count: How much was found; where counting stopped early, what was found until then.
            error: What to raise.

        Raises:
            InputFileError: If there are more than allowed; the sentence says how to raise the limit.
        """
        most = self.value
        if not count <= most:
            raise error(
                where,
                f"has at least {_grouped(count)} {self.unit}, above the limit of {_grouped(most)}; "
                f"if you trust it, set {self.variable} higher",
            )


FILE_BYTES = Limit("SLAMGYM_MAX_FILE_BYTES", 1 << 30, "bytes", "any file, after decompression")
DOCUMENT_BYTES = Limit(
    "SLAMGYM_MAX_DOCUMENT_BYTES",
    4 << 20,
    "bytes",
    "a floor plan, other JSON document, or line of a list",
)
DRAWING_BYTES = Limit(
    "SLAMGYM_MAX_DRAWING_BYTES", 64 << 20, "bytes", "a DXF, IFC or GeoJSON drawing"
)
WEIGHT_BYTES = Limit(
    "SLAMGYM_MAX_WEIGHT_BYTES", 4 << 30, "bytes", "weights, or the state of a training"
)
YAML_BYTES = Limit(
    "SLAMGYM_MAX_YAML_BYTES", 1 << 16, "bytes", "a YAML file: a map's description, a recipe"
)
DEPTH = Limit("SLAMGYM_MAX_DEPTH", 32, "levels of nesting", "a JSON or YAML document")
EXPANSION = Limit(
    "SLAMGYM_MAX_EXPANSION", 200, "bytes for each compressed one", "a compressed file above 4 MB"
)
ENTRIES = Limit(
    "SLAMGYM_MAX_ENTRIES",
    200_000,
    "entries",
    "an archive, a drawing (its blocks expanded), or a file of one floor a line",
)
PIXELS = Limit("SLAMGYM_MAX_PIXELS", 100_000_000, "pixels", "a picture")
VERTICES = Limit(
    "SLAMGYM_MAX_VERTICES", 50_000, "vertices", "a floor plan, holes and rooms included"
)
PLAN_PARTS = Limit(
    "SLAMGYM_MAX_PARTS", 10_000, "holes, rooms or doors", "a floor plan, of each kind"
)
CROSSINGS = Limit(
    "SLAMGYM_MAX_CROSSINGS", 1000, "places where the outline crosses itself", "an outline to repair"
)
NEAR_PAIRS = Limit(
    "SLAMGYM_MAX_NEAR_PAIRS",
    2_000_000,
    "pairs of walls close to each other",
    "a floor plan: closer than the robot is wide, which makes its geometry slow",
)
RUNS = Limit(
    "SLAMGYM_MAX_RUNS",
    1_000_000,
    "runs of floor or wall in its rows",
    "a picture traced as a floor plan, a map that is drawn",
)
MAP_CELLS = Limit(
    "SLAMGYM_MAX_MAP_CELLS",
    200_000_000,
    "cells",
    "the map that an explorer sees, which grows with the plan",
)
READER_SECONDS = Limit(
    "SLAMGYM_MAX_READER_SECONDS",
    300,
    "seconds",
    "reading a DXF or IFC drawing or a ROS bag, in a process of its own",
)
READER_BYTES = Limit(
    "SLAMGYM_MAX_READER_BYTES", 4 << 30, "bytes", "memory that such a process takes"
)
SCANS = Limit("SLAMGYM_MAX_SCANS", 1_000_000, "scans", "a log")

LIMITS = (
    FILE_BYTES, EXPANSION, ENTRIES, WEIGHT_BYTES, DRAWING_BYTES, DOCUMENT_BYTES, YAML_BYTES, DEPTH, PIXELS, RUNS,
    VERTICES, PLAN_PARTS, CROSSINGS, NEAR_PAIRS, MAP_CELLS, READER_SECONDS, READER_BYTES, SCANS,
)  # fmt: skip
"""All of them, in the order of the documentation."""

EXPANSION_FROM = 4 << 20
"""Below so many bytes a compressed file may expand by any factor."""


def shown(value: Any) -> str:
    """A value from a file as a message shows it: its ``repr`` in at most 80 characters.

    Nothing larger is built on the way: the ``repr`` of a few hundred bytes of nested YAML can take gigabytes.
    """
    text = " ".join(_brief.repr(value).split())
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


class _Brief(reprlib.Repr):
    """Shows the beginning of a value."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 2
        self.maxlist = self.maxtuple = self.maxset = self.maxdict = 4
        self.maxstring = self.maxother = MAX_SHOWN - 4

    def repr_int(self, x: int, level: int) -> str:  # noqa: ARG002 - the base class's signature
        """Python refuses to print whole numbers of thousands of digits."""
        return repr(x) if x.bit_length() < 200 else f"<a whole number of {x.bit_length()} bits>"

    def repr_str(self, x: str, level: int) -> str:
        """As itself where it fits: the base class cuts out the middle."""
        return super().repr_str(x[: self.maxstring], level)


_brief = _Brief()


def _grouped(count: float) -> str:
    return f"{count:,.0f}"

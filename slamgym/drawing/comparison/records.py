"""Result of a comparison, and its files."""

import csv
import io
import math
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from slamgym.core.documents import json_text
from slamgym.core.files import write_text
from slamgym.drawing.comparison.registration import Registration

FindingKind = Literal[
    "wall_present", "wall_moved", "wall_missing", "wall_unclear", "wall_not_seen", "wall_extra", "opening_new",
    "door_moved", "door_blocked", "door_width", "room_explored", "room_unexplored",
]  # fmt: skip
Line = tuple[float, float, float, float]

COLUMNS = (
    "kind", "what", "x0_m", "y0_m", "x1_m", "y1_m", "length_m", "offset_cm", "error_cm", "raw_offset_cm",
)  # fmt: skip


@dataclass(frozen=True)
class PlanFinding:
    """What was found out about a wall, door or room, in the plan's frame."""

    kind: FindingKind
    what: str
    """A room's name, or which wall or door."""
    line: Line
    """The middle line of a wall, or a door, as planned; an extra wall as found; a room's middle twice [m]."""
    offset: float | None = None
    """Distance it moved: a wall to its left (seen from its first end), a door along its line; or how much wider it is
    [m]. Without the map's own distortion."""
    error: float | None = None
    """Standard error of the offset [m]."""
    raw_offset: float | None = None
    """The offset with the map's distortion [m]."""
    seen: float | None = None
    """Share of a wall that is in view from the side that shows more, or of a room's floor that is free."""

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return math.dist(self.line[:2], self.line[2:])


@dataclass(frozen=True)
class PlanComparison:
    """As built against as planned."""

    plan: str
    map: str
    registration: Registration
    changes: tuple[PlanFinding, ...]
    walls: tuple[PlanFinding, ...]
    """All of the plan, changed or not."""
    rooms: tuple[PlanFinding, ...]
    doubts: tuple[str, ...]

    @property
    def is_confident(self) -> bool:
        """True if plan and map are of one building; else it holds no changes."""
        return self.registration.is_same_building

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        x, y, theta = self.registration.plan_from_map
        plain = asdict(self)
        plain["registration"] |= {
            "score": self.registration.score,
            "plan_from_map": {"x_m": x, "y_m": y, "theta_rad": theta},
        }
        by_kind = Counter(wall.kind for wall in self.walls)
        return {**plain, "confident": self.is_confident, "walls_by_kind": by_kind}

    def table(self) -> list[list[str]]:
        """A row a change: :data:`COLUMNS`, as text."""
        rows = []
        for change in self.changes:
            places = [f"{value:.2f}" for value in (*change.line, change.length)]
            moved = [change.offset, change.error, change.raw_offset]
            by = ["" if value is None else f"{100.0 * value:.1f}" for value in moved]
            rows.append([change.kind, change.what, *places, *by])
        return rows


def write_comparison(folder: Path, comparison: PlanComparison) -> None:
    """Write ``comparison.csv``, a row a change, and ``comparison.json``, which goes last."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(comparison.table())
    write_text(folder / "comparison.csv", text.getvalue())
    write_text(folder / "comparison.json", json_text(comparison.document()))

"""Result of a comparison, and its files."""

import csv
import io
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from slamgym.core.documents import json_text
from slamgym.core.files import write_text
from slamgym.drawing.comparison.registration import Registration

ChangeKind = Literal[
    "wall_moved", "wall_covered", "wall_missing", "wall_extra", "opening_new",
    "door_moved", "door_blocked", "door_width", "room_unexplored",
]  # fmt: skip
WallState = Literal["present", "moved", "covered", "missing", "unclear", "not_seen"]
Line = tuple[float, float, float, float]

COLUMNS = (
    "kind", "what", "x0_m", "y0_m", "x1_m", "y1_m", "length_m", "offset_cm", "error_cm", "raw_offset_cm", "note",
)  # fmt: skip


@dataclass(frozen=True)
class Change:
    """One difference between plan and map, in the plan's frame."""

    kind: ChangeKind
    what: str
    """Subject of the change: a room's name, or which wall or door."""
    line: Line
    """The wall or door as planned; the extra wall as found; a room's middle twice [m]."""
    length: float
    """[m]"""
    offset: float | None = None
    """Distance it moved: a wall to its left (seen from its first end), a door along its line; or how much wider it is
    [m]. Without the map's own distortion."""
    error: float | None = None
    """Standard error of the offset [m]."""
    raw_offset: float | None = None
    """The offset with the map's distortion [m]."""
    note: str = ""


@dataclass(frozen=True)
class WallReport:
    """One straight wall of the plan."""

    line: Line
    """Its middle line [m]."""
    length: float
    """[m]"""
    state: WallState
    seen: float
    """Share of it that is in view from the side that shows more."""
    offset: float | None = None
    """To the left of its line, without the map's distortion [m]."""
    error: float | None = None
    raw_offset: float | None = None
    distortion: float | None = None
    """Distance by which the map's distortion moves it to the left [m]."""
    note: str = ""


@dataclass(frozen=True)
class PlanComparison:
    """As built against as planned."""

    plan: str
    map: str
    registration: Registration
    changes: tuple[Change, ...]
    walls: tuple[WallReport, ...]
    rooms: tuple[tuple[str, float], ...]
    """Names, and which share of each the robot has seen."""
    doubts: tuple[str, ...]

    @property
    def is_confident(self) -> bool:
        """True if plan and map are of one building; else it holds no changes."""
        return self.registration.is_same_building

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        pose = self.registration.plan_from_map
        states = [wall.state for wall in self.walls]
        return {
            "plan": self.plan,
            "map": self.map,
            "confident": self.is_confident,
            "doubts": list(self.doubts),
            "registration": {
                **{k: v for k, v in asdict(self.registration).items() if k != "plan_from_map"},
                "plan_from_map": {"x_m": pose.x, "y_m": pose.y, "theta_rad": pose.theta},
            },
            "walls_by_state": {state: states.count(state) for state in sorted(set(states))},
            "changes": [asdict(change) for change in self.changes],
            "walls": [asdict(wall) for wall in self.walls],
            "rooms": [{"name": name, "seen": share} for name, share in self.rooms],
        }

    def table(self) -> list[list[str]]:
        """A row a change: :data:`COLUMNS`, as text."""
        return [
            [
                change.kind,
                change.what,
                *(f"{value:.2f}" for value in (*change.line, change.length)),
                *(
                    "" if value is None else f"{100.0 * value:.1f}"
                    for value in (change.offset, change.error, change.raw_offset)
                ),
                change.note,
            ]
            for change in self.changes
        ]


def write_comparison(folder: Path, comparison: PlanComparison) -> None:
    """Write ``comparison.csv``, a row a change, and ``comparison.json``, which goes last."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(comparison.table())
    write_text(folder / "comparison.csv", text.getvalue())
    write_text(folder / "comparison.json", json_text(comparison.document()))

"""Several sources of floor plans as one, each with its share."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.sources import PlanSource, open_plans
from slamgym.core.errors import ConfigError


@dataclass(frozen=True)
class PlanGroup:
    """The plans of one source."""

    ids: Sequence[str]
    weight: float
    """Share of this source among all that are drawn, relative to the other weights."""


class MixedSource:
    """Plans of several sources; where two have a plan of the same name, the later one's gets another."""

    def __init__(self, sources: Sequence[PlanSource], weights: Sequence[float]) -> None:
        self._places: dict[str, tuple[PlanSource, str]] = {}
        groups = []
        for number, (source, weight) in enumerate(zip(sources, weights, strict=True), start=1):
            names = []
            for plan_id in source.ids:
                name = plan_id if plan_id not in self._places else f"{plan_id}~{number}"
                if name in self._places:
                    raise ConfigError(f"two sources of plans both have a plan {name!r}; rename one")
                self._places[name] = (source, plan_id)
                names.append(name)
            groups.append(PlanGroup(names, weight))
        self.groups: tuple[PlanGroup, ...] = tuple(groups)
        self.ids: Sequence[str] = list(self._places)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan; it carries the name that it has here."""
        source, inner = self._places[plan_id]
        plan = source.load(inner)
        return plan if plan.id == plan_id else dataclasses.replace(plan, id=plan_id)


def plan_groups(source: PlanSource) -> tuple[PlanGroup, ...]:
    """The groups of a mixed source; any other source is one group."""
    return source.groups if isinstance(source, MixedSource) else (PlanGroup(source.ids, 1.0),)


def open_plan_mix(specs: Sequence[str], ids_file: Path | str | None = None) -> PlanSource:
    """Open one or several sources of floor plans.

    Args:
        specs: What :func:`slamgym.cad.open_plans` takes, each perhaps with ``=WEIGHT`` behind it; one string
            may hold several, with commas between them. Weights are relative, 1 where none is given.
        ids_file: As :func:`slamgym.cad.open_plans` takes it; needs a single source.

    Returns:
        The source itself if there is one, else a :class:`MixedSource`.

    Raises:
        InputFileError: If a file is missing, unreadable or holds no plans.
        ConfigError: If a spec is neither a file nor a known name, is given twice, or has a weight of 0.
    """
    parts = [_split_weight(part) for spec in specs for part in _split_list(spec)]
    if not parts:
        raise ConfigError("no floor plans are named; give a file, a folder, 'bundled' or 'procedural'")
    names = [name for name, _ in parts]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(f"the plans {twice[0]!r} are given twice; give one weight instead")
    if len(parts) == 1:
        return open_plans(names[0], ids_file=ids_file)
    if ids_file is not None:
        raise ConfigError("a file of plan ids needs a single source of plans")
    return MixedSource([open_plans(name) for name in names], [weight for _, weight in parts])


def _split_list(spec: str) -> list[str]:
    """Split at commas, unless a file has that name."""
    if "," in spec and Path(spec).exists():
        return [spec]
    return [part.strip() for part in spec.split(",") if part.strip()]


def _split_weight(spec: str) -> tuple[str, float]:
    """The spec and its weight; a file whose name has a ``=`` is taken as it is."""
    name, equals, text = spec.rpartition("=")
    if not equals or Path(spec).exists():
        return spec, 1.0
    try:
        weight = float(text)
    except ValueError:
        return spec, 1.0
    if not 0.0 < weight < float("inf"):
        raise ConfigError(f"the weight in {spec!r} must be a number above 0")
    return name, weight

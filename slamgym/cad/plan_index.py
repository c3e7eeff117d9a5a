"""Sets of floor plans by their ids, parts of them, and several of them at once."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from slamgym.cad.floorplan import FloorPlan
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.limits import shown


class PlanSource(Protocol):
    """A set of floor plans, read one at a time when they are needed."""

    @property
    def ids(self) -> Sequence[str]:
        """Names of all plans, in a fixed order."""
        ...

    def __len__(self) -> int: ...

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan.

        Raises:
            PlanError: If its file is missing or malformed.
            KeyError: If the source has no plan of this name.
        """
        ...


@dataclass(frozen=True)
class PlanGroup:
    """The plans of one source."""

    ids: Sequence[str]
    weight: float
    """Share of this source among all that are drawn, relative to the other weights."""


class PlanIndex:
    """Plans by their ids: one function reads them all.

    Args:
        places: The arguments of the function for each id, in the order of the plans.
        read: Makes a plan of them.
        groups: Of a mix of sources; else all plans are one group.
    """

    def __init__(
        self,
        places: Mapping[str, tuple[Any, ...]],
        read: Callable[..., FloorPlan],
        groups: Sequence[PlanGroup] = (),
    ) -> None:
        self._places = places
        self._read = read
        self.ids: Sequence[str] = list(places)
        self.groups = tuple(groups) or (PlanGroup(self.ids, 1.0),)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan."""
        return self._read(*self._places[plan_id])


def some_plans(source: PlanSource, ids: Sequence[str]) -> PlanIndex:
    """Some plans of another source."""
    return PlanIndex({plan_id: (plan_id,) for plan_id in ids}, source.load)


def mixed_plans(sources: Sequence[PlanSource], weights: Sequence[float]) -> PlanIndex:
    """Plans of several sources; where two have a plan of the same name, the later one's gets another.

    Raises:
        ConfigError: If names are the same even so.
    """
    places: dict[str, tuple[PlanSource, str, str]] = {}
    groups = []
    for number, (source, weight) in enumerate(zip(sources, weights, strict=True), start=1):
        names = []
        for plan_id in source.ids:
            name = plan_id if plan_id not in places else f"{plan_id}~{number}"
            if name in places:
                raise ConfigError(f"two sources of plans both have a plan {name!r}; rename one")
            places[name] = (source, plan_id, name)
            names.append(name)
        groups.append(PlanGroup(names, weight))
    return PlanIndex(places, _load_renamed, groups)


def _load_renamed(source: PlanSource, plan_id: str, name: str) -> FloorPlan:
    """A plan with the name that it has in the mix."""
    plan = source.load(plan_id)
    return plan if plan.id == name else dataclasses.replace(plan, id=name)


def plan_groups(source: PlanSource) -> tuple[PlanGroup, ...]:
    """The groups of a mixed source; any other source is one group."""
    return source.groups if isinstance(source, PlanIndex) else (PlanGroup(source.ids, 1.0),)


def refuse_second(places: Mapping[str, Path], plan_id: str, place: Path, where: Path) -> None:
    """Refuse a second plan of the same name: splits and seeds go by the names, so neither may be renamed or lost."""
    if plan_id in places:
        first = _within(places[plan_id], where)
        second = _within(place, where)
        raise InputFileError(
            where,
            f"holds two plans called {shown(plan_id)}, {shown(first)} and {shown(second)}; rename one, or "
            "give the folders as two sources, with a comma between them",
        )


def _within(path: Path, folder: Path) -> str:
    """A path as it is called in a folder, or whole if it lies elsewhere."""
    return str(path.relative_to(folder) if path.is_relative_to(folder) else path)

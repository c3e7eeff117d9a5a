"""Where floor plans come from: files, folders, archives, drawings, maps, the generator, and several of them at once."""

import dataclasses
import tarfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.generator import Kind, PlanGeneratorConfig, generate_plan
from slamgym.cad.houseexpo import parse_houseexpo, read_houseexpo
from slamgym.cad.image_plan import PictureSource
from slamgym.cad.plan_files.source import DRAWING_SUFFIXES, DrawingSource
from slamgym.cad.room_lines import RoomLinesSource
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_text
from slamgym.core.limits import DOCUMENT_BYTES, ENTRIES, shown
from slamgym.core.pictures import PICTURE_SUFFIXES
from slamgym.core.streams import DAMAGED, open_expanded

BUNDLED = Path(__file__).parent / "bundled"
"""The plans that come with the package."""

PROCEDURAL_COUNT = 10_000
"""Plans that ``procedural`` offers for one seed."""


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


class FileSource:
    """Plans in HouseExpo files of their own."""

    def __init__(self, paths: Iterable[Path], root: Path | None = None) -> None:
        places: dict[str, str] = {}
        self._paths: dict[str, Path] = {}
        for path in sorted(paths):
            place = path.relative_to(root) if root else path.name
            _note_place(places, path.stem, str(place), root or path.parent)
            self._paths[path.stem] = path
        self.ids: Sequence[str] = list(self._paths)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan."""
        return read_houseexpo(self._paths[plan_id])


class ArchiveSource:
    """Plans in HouseExpo's own ``.tar.gz``, which is read through once and kept as text.

    A gzip stream can't be read from the middle, so the choice is between reading 17 MB once (0.8 s for
    the 23,647 training plans, which take 60 MB) and reading on average half of it for every plan.
    """

    def __init__(self, path: Path, wanted: frozenset[str] | None = None) -> None:
        self._path = path
        self._texts: dict[str, bytes] = {}
        places: dict[str, str] = {}
        try:
            # ignore: tarfile asks for no more of a file than read().
            with open_expanded(path) as file, tarfile.open(fileobj=file, mode="r|") as archive:  # type: ignore[call-overload]
                for number, member in enumerate(archive, start=1):
                    ENTRIES.check(path, number)
                    name = Path(member.name)
                    if not member.isfile() or name.suffix != ".json" or name.name.startswith("."):
                        continue
                    _note_place(places, name.stem, member.name, path)
                    if wanted is None or name.stem in wanted:
                        DOCUMENT_BYTES.check(f"{path}:{shown(member.name)}", member.size)
                        content = archive.extractfile(member)
                        self._texts[name.stem] = content.read() if content else b""
                    archive.members = []  # which would grow with every entry
        except (OSError, ValueError, tarfile.TarError, *DAMAGED) as error:
            raise InputFileError(path, f"is not a readable archive ({error}); download it again") from None
        self.ids: Sequence[str] = sorted(self._texts)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan."""
        return parse_houseexpo(self._texts[plan_id], f"{self._path}:{plan_id}.json", plan_id)


def _note_place(places: dict[str, str], plan_id: str, place: str, where: Path) -> None:
    """Refuse a second plan of the same name: splits and seeds go by the names, so neither may be renamed or lost."""
    if plan_id in places:
        raise InputFileError(
            where,
            f"holds two plans called {shown(plan_id)}, {shown(places[plan_id])} and {shown(place)}; rename one, or "
            "give the folders as two sources, with a comma between them",
        )
    places[plan_id] = place


class ProceduralSource:
    """Plans that the generator makes when they are asked for."""

    def __init__(
        self,
        seed: int = 0,
        config: PlanGeneratorConfig | None = None,
        count: int = PROCEDURAL_COUNT,
        name: str = "procedural",
    ) -> None:
        self._config = config or PlanGeneratorConfig()
        self._indices = {f"{name}_{seed}_{index:05d}": (seed, index) for index in range(count)}
        self.ids: Sequence[str] = list(self._indices)

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Make one plan; each has a random stream of its own, so the order doesn't matter."""
        return generate_plan(np.random.default_rng(self._indices[plan_id]), self._config, plan_id)


class Subset:
    """Some plans of another source."""

    def __init__(self, source: PlanSource, ids: Sequence[str]) -> None:
        self._source = source
        self.ids = ids

    def __len__(self) -> int:
        return len(self.ids)

    def load(self, plan_id: str) -> FloorPlan:
        """Read one plan."""
        return self._source.load(plan_id)


def open_plans(spec: Path | str, ids_file: Path | str | None = None) -> PlanSource:
    """Open a set of floor plans.

    Args:
        spec: ``bundled``; ``procedural``, plans that the generator makes on the fly, and behind it, each
            after a colon, ``home`` or ``office`` for one kind only, ``loops`` for a loop in every
            plan, and a seed, as in ``procedural:office:loops:7``; a HouseExpo JSON file, a folder of them, or
            an archive of them (``.tar.gz``); a ROS map's ``.yaml``, or a
            folder of them; floors as rooms with portals (``.jsonl``
            or ``.jsonl.xz``); a black/white picture with its metres per pixel, as in ``plan.png@0.05``; a DXF drawing,
            with the metres of its unit behind it where it doesn't say them, as in ``plan.dxf@0.001``; an IFC model,
            each storey a plan; walls as GeoJSON.
        ids_file: A file with one plan id a line, as HouseExpo's ``map_id_train.txt``: only these plans.

    Returns:
        The plans, in the order of their ids; in the order of ``ids_file`` where that is given.

    Raises:
        InputFileError: If a file is missing, unreadable or holds no plans, or an id is not there.
        ConfigError: If ``spec`` is neither a file nor a known name.
    """
    wanted = read_ids(ids_file) if ids_file is not None else None
    source = _open(str(spec), frozenset(wanted) if wanted is not None else None)
    if wanted is None:
        if not source.ids:
            raise InputFileError(spec, "holds no floor plans; a plan is a HouseExpo .json file")
        return source
    there = set(source.ids)
    missing = [plan_id for plan_id in wanted if plan_id not in there]
    if missing:
        raise InputFileError(
            ids_file,
            f"{len(missing)} of its {len(wanted)} ids are not in {spec}, the first is {shown(missing[0])}",
        )
    return Subset(source, wanted)


def read_ids(path: Path | str) -> list[str]:
    """Read plan ids, one a line, without blank lines and repetitions.

    Raises:
        InputFileError: If the file can't be read or has no ids.
    """
    lines = read_text(path).splitlines()
    ids = list(dict.fromkeys(line.strip().removesuffix(".json") for line in lines if line.strip()))
    if not ids:
        raise InputFileError(path, "has no plan ids; give one a line")
    return ids


def _existing(name: str) -> Path:
    path = Path(name)
    if not path.exists():
        raise InputFileError(name, "there is no such file or folder")
    return path


def _metres_per_pixel(spec: str, text: str) -> float:
    """The resolution of a picture, or the unit of a drawing, after the ``@``."""
    try:
        resolution = float(text)
    except ValueError:
        resolution = 0.0
    if not 0.0 < resolution < 10.0:
        raise ConfigError(
            f"the metres per pixel or unit in {spec!r} must be a number above 0, as in 'plan.png@0.05'"
        )
    return resolution


def _procedural(spec: str) -> ProceduralSource:
    """Read what stands behind ``procedural:``."""
    kind: Kind = "mixed"
    loops, seed = PlanGeneratorConfig.loops, 0
    words = [word for word in spec.split(":")[1:] if word]
    for word in words:
        if word in ("home", "office"):
            kind = "home" if word == "home" else "office"
        elif word == "loops":
            loops = 1.0
        elif word.isascii() and word.isdigit():
            seed = int(word)
        else:
            raise ConfigError(
                f"{word!r} in {spec!r} must be a whole number (the seed), 'home', 'office' or 'loops', "
                "as in 'procedural:7' or 'procedural:office:loops'"
            )
    name = "_".join(["procedural" if kind == "mixed" else kind, *(["loops"] if "loops" in words else [])])
    return ProceduralSource(seed, PlanGeneratorConfig(kind=kind, loops=loops), name=name)


def _open(spec: str, wanted: frozenset[str] | None) -> PlanSource:
    """Choose the reader by what ``spec`` looks like."""
    if spec == "bundled":
        # In turns, by their numbers: a dataset begins with homes, and soon has its share of offices.
        kinds = [FileSource(BUNDLED.glob(f"{kind}_*.json")) for kind in ("home", "office")]
        return MixedSource(kinds, [len(kind) for kind in kinds])
    if spec == "procedural" or spec.startswith("procedural:"):
        return _procedural(spec)
    name, _, resolution = spec.rpartition("@")
    if name.lower().endswith(PICTURE_SUFFIXES):
        metres_per_pixel = _metres_per_pixel(spec, resolution)
        return PictureSource([_existing(name)], metres_per_pixel)
    if name.lower().endswith(".dxf"):
        return DrawingSource(_existing(name), _metres_per_pixel(spec, resolution))
    path = Path(spec)
    if path.is_dir():
        return _open_folder(path)
    if not path.exists():
        if path.suffix or "/" in spec:
            _existing(spec)
        names = suggest(spec, ["bundled", "procedural"])
        raise ConfigError(f"there are no plans called {spec!r}; give a path or a known name: {names}")
    if path.name.endswith((".tar.gz", ".tgz", ".tar")):
        return ArchiveSource(path, wanted)
    if path.suffix == ".json":
        return FileSource([path])
    if path.name.endswith((".jsonl", ".jsonl.xz")):
        return RoomLinesSource(path)
    if path.suffix in (".yaml", ".yml"):
        return PictureSource([path])
    if path.suffix.lower() in DRAWING_SUFFIXES:
        return DrawingSource(path)
    if spec.lower().endswith(PICTURE_SUFFIXES):
        raise InputFileError(spec, f"a picture needs its metres per pixel; write {spec}@0.05, for example")
    raise InputFileError(
        spec,
        "is no known kind of floor plan; give .json, .dxf, .ifc, .geojson, a folder, .tar.gz, .jsonl, a ROS .yaml "
        "or a picture",
    )


def _open_folder(path: Path) -> PlanSource:
    """HouseExpo plans, or else ROS maps."""
    plans, maps = list(path.glob("*.json")), list(path.glob("*.yaml"))
    if maps and not plans:
        return PictureSource(maps)
    # HouseExpo unpacks into a folder within a folder.
    return FileSource(plans or path.rglob("*.json"), path)


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

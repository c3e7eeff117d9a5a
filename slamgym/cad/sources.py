"""Where floor plans come from: files, folders, archives, drawings, maps, the generator, and several of them at once."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from slamgym.cad.floorplan import FloorPlan
from slamgym.cad.generator import Kind, PlanGeneratorConfig, generate_plan
from slamgym.cad.houseexpo import read_houseexpo
from slamgym.cad.image_plan import read_ros_plan
from slamgym.cad.plan_formats import PLAN_FILES, PlanFormat, PlanOptions, plan_format
from slamgym.cad.plan_index import PlanIndex, PlanSource, mixed_plans, refuse_second, some_plans
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_text
from slamgym.core.limits import shown

BUNDLED = Path(__file__).parent / "bundled"
"""The plans that come with the package."""

PROCEDURAL_COUNT = 10_000
"""Plans that ``procedural`` offers for one seed."""


def plan_files(paths: Iterable[Path], root: Path | None = None) -> PlanIndex:
    """Plans in separate HouseExpo files."""
    places: dict[str, Path] = {}
    for path in sorted(paths):
        refuse_second(places, path.stem, path, root or path.parent)
        places[path.stem] = path
    return PlanIndex({plan_id: (path,) for plan_id, path in places.items()}, read_houseexpo)


def generated_plans(
    seed: int = 0,
    config: PlanGeneratorConfig | None = None,
    count: int = PROCEDURAL_COUNT,
    name: str = "procedural",
) -> PlanIndex:
    """Plans that the generator makes when they are asked for; each has its own random stream."""
    config = config or PlanGeneratorConfig()
    places = {}
    for index in range(count):
        plan_id = f"{name}_{seed}_{index:05d}"
        places[plan_id] = ((seed, index), config, plan_id)
    return PlanIndex(places, _generate)


def _generate(seeds: tuple[int, int], config: PlanGeneratorConfig, plan_id: str) -> FloorPlan:
    return generate_plan(np.random.default_rng(seeds), config, plan_id)


def open_drawing(spec: str, layers: Sequence[str] = ()) -> PlanSource:
    """The same as :func:`open_plans`, but of a drawing that doesn't say its unit the plan says what is doubtful.

    Args:
        spec: As :func:`open_plans` takes it.
        layers: Of a DXF drawing's walls, see :func:`slamgym.cad.read_dxf`.

    Raises:
        InputFileError: If a file is missing, unreadable or holds no plans.
        ConfigError: If ``spec`` is neither a file nor a known name, or there are layers and no DXF drawing.
    """
    source = _open(spec, PlanOptions(layers=tuple(layers), may_doubt=True))
    _refuse_empty(source, spec)
    return source


def open_plans(
    spec: Path | str, ids_file: Path | str | None = None, layers: Sequence[str] = ()
) -> PlanSource:
    """Open a set of floor plans.

    Args:
        spec: ``bundled``; ``procedural``, plans that the generator makes on the fly, and behind it, each
            after a colon, ``home`` or ``office`` for one kind only, ``loops`` for a loop in every
            plan, and a seed, as in ``procedural:office:loops:7``; a file of one of the
            :data:`~slamgym.cad.plan_formats.PLAN_FORMATS`, with the metres of a picture's pixel or a drawing's unit
            behind it, as in ``plan.png@0.05``; a folder of HouseExpo files or ROS maps.
        ids_file: A file with one plan id a line, as HouseExpo's ``map_id_train.txt``: only these plans.
        layers: Of a DXF drawing's walls, see :func:`slamgym.cad.read_dxf`.

    Returns:
        The plans, in the order of their ids; in the order of ``ids_file`` where that is given.

    Raises:
        InputFileError: If a file is missing, unreadable or holds no plans, or an id is not there.
        ConfigError: If ``spec`` is neither a file nor a known name, or there are layers and no DXF drawing.
    """
    wanted = read_ids(ids_file) if ids_file is not None else None
    only = None if wanted is None else frozenset(wanted)
    source = _open(str(spec), PlanOptions(wanted=only, layers=tuple(layers)))
    if wanted is None:
        _refuse_empty(source, spec)
        return source
    there = set(source.ids)
    missing = [plan_id for plan_id in wanted if plan_id not in there]
    if missing:
        raise InputFileError(
            ids_file,
            f"{len(missing)} of its {len(wanted)} ids are not in {spec}, the first is {shown(missing[0])}",
        )
    return some_plans(source, wanted)


def _refuse_empty(source: PlanSource, spec: Path | str) -> None:
    if not source.ids:
        raise InputFileError(spec, "holds no floor plans; a plan is a HouseExpo .json file")


def read_ids(path: Path | str) -> list[str]:
    """Read plan ids, one a line, without blank lines and repetitions.

    Raises:
        InputFileError: If the file can't be read or has no ids.
    """
    lines = [line.strip() for line in read_text(path).splitlines()]
    ids = list(dict.fromkeys(line.removesuffix(".json") for line in lines if line))
    if not ids:
        raise InputFileError(path, "has no plan ids; give one a line")
    return ids


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


def _procedural(spec: str) -> PlanIndex:
    """Read what stands behind ``procedural:``."""
    kind: Kind = "mixed"
    loops = PlanGeneratorConfig.loops
    seed = 0
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
    name: str = "procedural" if kind == "mixed" else kind
    if "loops" in words:
        name += "_loops"
    return generated_plans(seed, PlanGeneratorConfig(kind=kind, loops=loops), name=name)


def _open(spec: str, options: PlanOptions) -> PlanSource:
    """Choose the reader by what ``spec`` looks like."""
    name, kind, scale = _split_scale(spec)
    if options.layers and not (kind and kind.has_layers):
        raise ConfigError("--layers needs a DXF drawing")
    if spec == "bundled":
        # In turns, by their numbers: a dataset begins with homes, and soon has its share of offices.
        homes = plan_files(BUNDLED.glob("home_*.json"))
        offices = plan_files(BUNDLED.glob("office_*.json"))
        return mixed_plans([homes, offices], [len(homes), len(offices)])
    if spec == "procedural" or spec.startswith("procedural:"):
        return _procedural(spec)
    path = Path(name)
    if path.is_dir():
        return _open_folder(path)
    if not path.exists():
        if path.suffix or "/" in spec:
            raise InputFileError(name, "there is no such file or folder")
        names = suggest(spec, ["bundled", "procedural"])
        raise ConfigError(f"there are no plans called {spec!r}; give a path or a name; {names}")
    if kind is None:
        raise InputFileError(spec, f"is no known kind of floor plan; give {PLAN_FILES}")
    return kind.open(path, options._replace(scale=scale))


def _split_scale(spec: str) -> tuple[str, PlanFormat | None, float | None]:
    """The name of a file, its format, and the metres of a pixel or unit if they stand behind the ``@``."""
    name, _, text = spec.rpartition("@")
    kind = plan_format(name)
    if kind is None or not kind.has_scale:
        return spec, plan_format(spec), None
    return name, kind, _metres_per_pixel(spec, text)


def _open_folder(path: Path) -> PlanSource:
    """HouseExpo plans, or else ROS maps."""
    plans = list(path.glob("*.json"))
    maps = list(path.glob("*.yaml"))
    if maps and not plans:
        return PlanIndex({map_.stem: (map_,) for map_ in sorted(maps)}, read_ros_plan)
    # HouseExpo unpacks into a folder within a folder.
    return plan_files(plans or path.rglob("*.json"), path)


def open_plan_mix(
    specs: Sequence[str], ids_file: Path | str | None = None, layers: Sequence[str] = ()
) -> PlanSource:
    """Open one or several sources of floor plans.

    Args:
        specs: What :func:`slamgym.cad.open_plans` takes, each perhaps with ``=WEIGHT`` behind it; one string
            may hold several, with commas between them. Weights are relative, 1 where none is given.
        ids_file: As :func:`slamgym.cad.open_plans` takes it; needs a single source.
        layers: The same of all sources, which are DXF drawings then.

    Returns:
        The source itself if there is one, else a mix of them.

    Raises:
        InputFileError: If a file is missing, unreadable or holds no plans.
        ConfigError: If a spec is neither a file nor a known name, is given twice, or has a weight of 0.
    """
    parts = [_split_weight(part) for spec in specs for part in _split_list(spec)]
    if not parts:
        raise ConfigError(
            "no floor plans are named; give a file, a folder, 'bundled' or 'procedural'"
        )
    names = [name for name, _ in parts]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigError(f"the plans {twice[0]!r} are given twice; give one weight instead")
    if len(parts) == 1:
        return open_plans(names[0], ids_file=ids_file, layers=layers)
    if ids_file is not None:
        raise ConfigError("a file of plan ids needs a single source of plans")
    sources = [open_plans(name, layers=layers) for name in names]
    return mixed_plans(sources, [weight for _, weight in parts])


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

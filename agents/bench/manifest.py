"""The frozen list of the benchmark: buildings, starts and seeds, and the check that the plans at hand are those.

``frozen/manifest.json`` lists each exploration of each track. Plans that may be passed on lie next to it in
``plans.tar.xz``, as HouseExpo files; HouseExpo's own are named by their ids alone, and read from the user's copy. Every
plan is compared by the SHA-256 of its outline, and furniture by its number of faces and their length.
"""

import dataclasses
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from shapely import LinearRing

from slamgym.agents.evaluation.trial import Task, TrialConfig
from slamgym.cad import FloorPlan, PlanSource, open_plans
from slamgym.cad.archives import archived_plans
from slamgym.core.config import from_dict, suggest
from slamgym.core.documents import read_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import sha256_of
from slamgym.core.limits import DRAWING_BYTES
from slamgym.core.provenance import check_origin
from slamgym.core.types import IntArray, Pose2D
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.envs.episode import fitted_env
from slamgym.sim import ClutterConfig

BENCH = "slamgym-bench"
"""Name of the benchmark in its files."""
BENCH_VERSION = 2
"""Version of the list; another list or another robot would be another benchmark. In version 1 all beams measured at
once."""
FROZEN = Path(__file__).parent / "frozen"
"""Folder of the list and of the plans that come with it."""
MANIFEST = FROZEN / "manifest.json"
"""The list."""
SHIPPED_PLANS = FROZEN / "plans.tar.xz"
"""Plans that may be passed on."""
TEAMS = "teams"
"""The track on which teams are compared, as ``rl*2``: the buildings of ``loops``, in which a map that is laid wrong
costs most."""
QUICK = 12
"""Explorations of the quick subset: the first ones of a track, whose order is drawn."""

_GRAIN = 1e-4
"""Outlines are compared to this [m]."""
_FURNITURE_TOLERANCE = 1e-3
"""Share by which the length of the furniture's faces may differ: rounding differs between machines."""


@dataclass(frozen=True)
class TrackBuilding:
    """One exploration of a track."""

    plan: str
    """Id of the plan."""
    outline: str
    """:func:`outline_hash`."""
    seed: int
    """Seed of noise, furniture, people and explorer."""
    start: tuple[float, float, float]
    """x [m], y [m], theta [rad] in the plan's frame."""
    furniture: tuple[int, float] = (0, 0.0)
    """Faces of all furniture and their length [m]."""


@dataclass(frozen=True)
class Track:
    """Explorations of one kind."""

    name: str
    about: str
    shipped: bool
    """True if the plans come with the package; else they are HouseExpo's."""
    clutter: ClutterConfig
    buildings: tuple[TrackBuilding, ...]

    @property
    def trial(self) -> TrialConfig:
        """Settings of each exploration: default mapper and sensors, the promise of 98 % with 95 % certainty."""
        return TrialConfig(env=ExploreConfig(clutter=self.clutter))

    def quick(self) -> "Track":
        """The first :data:`QUICK` explorations."""
        return dataclasses.replace(self, buildings=self.buildings[:QUICK])


@dataclass(frozen=True)
class Manifest:
    """The whole benchmark."""

    version: int
    tracks: tuple[Track, ...]
    sha256: str
    """Hash of the file."""

    def track(self, name: str) -> Track:
        """A track by its name.

        Raises:
            ConfigError: If there is none of that name.
        """
        for track in self.tracks:
            if track.name == name:
                return track
        names = [track.name for track in self.tracks]
        raise ConfigError(f"no track {name!r}; {suggest(name, names)}")


def read_bench(path: Path = MANIFEST) -> Manifest:
    """Read the list.

    Raises:
        InputFileError: If it can't be read, isn't what came with the package, or is of another form.
    """
    check_origin(path)
    document = read_json(path, "install slamgym again", DRAWING_BYTES)
    try:
        if document["bench"] != BENCH or document["version"] != BENCH_VERSION:
            raise ConfigError(f"is not {BENCH} {BENCH_VERSION}")
        tracks = tuple(
            from_dict(Track, {"name": name, **track}) for name, track in document["tracks"].items()
        )
        (loops,) = (track for track in tracks if track.name == "loops")
    except (KeyError, TypeError, ValueError, AttributeError, ConfigError) as error:
        raise InputFileError(
            path, f"is no manifest of {BENCH} ({error}); install slamgym again"
        ) from None
    tracks += (dataclasses.replace(loops, name=TEAMS, about=f"{loops.about}, for teams"),)
    return Manifest(BENCH_VERSION, tracks, sha256_of(path))


def open_bench_plans(track: Track, houseexpo: str) -> PlanSource:
    """The source of a track's plans.

    Args:
        track: The track.
        houseexpo: The user's copy of HouseExpo, as :func:`slamgym.cad.open_plans` takes it.

    Raises:
        ConfigError: If the copy isn't there.
        InputFileError: If it can't be read.
    """
    if track.shipped:
        check_origin(SHIPPED_PLANS)
        return archived_plans(SHIPPED_PLANS)
    path = Path(houseexpo)
    if not path.exists():
        raise ConfigError(
            f"the track {track.name!r} takes plans of HouseExpo, and there is no {houseexpo}; run "
            "`slamgym plans fetch`, or give your copy with --plans"
        )
    if path.is_dir() or path.suffix == ".json":
        return open_plans(houseexpo)
    return archived_plans(path, frozenset(building.plan for building in track.buildings))


def bench_tasks(track: Track, source: PlanSource, explorer: str) -> list[Task]:
    """The explorations of a track, each plan checked against the manifest.

    Raises:
        ConfigError: If plans are missing or differ, or furniture does; the sentence names the first.
        PlanError: If a plan can't be read.
    """
    ids = set(source.ids)
    missing = [building.plan for building in track.buildings if building.plan not in ids]
    if missing:
        raise ConfigError(
            f"{len(missing)} of the {len(track.buildings)} plans of the track {track.name!r} are not in these plans, "
            f"the first is {missing[0]}; give HouseExpo's archive json.tar.gz (`slamgym plans fetch`)"
        )
    tasks = []
    for building in track.buildings:
        plan = source.load(building.plan)
        if outline_hash(plan) != building.outline:
            raise ConfigError(
                f"the plan {plan.id} ({plan.where}) has another outline than {BENCH} {BENCH_VERSION} names (SHA-256), "
                "so results would not be comparable; give HouseExpo's own files, unchanged"
            )
        if any(building.furniture):
            _refuse_other_furniture(plan, building, track)
        tasks.append(Task(explorer, plan, building.seed, Pose2D(*building.start)))
    return tasks


def _refuse_other_furniture(plan: FloorPlan, building: TrackBuilding, track: Track) -> None:
    """Refuse to explore a plan that this version furnishes differently.

    Raises:
        ConfigError: If it does.
    """
    found = furniture_of(plan, building.seed, track)
    if not np.allclose(found, building.furniture, rtol=_FURNITURE_TOLERANCE):
        raise ConfigError(
            f"this version of slamgym furnishes {plan.id} differently ({found[0]} faces instead of "
            f"{building.furniture[0]}) from {BENCH} {BENCH_VERSION}; use the version that "
            "made the other results"
        )


def furniture_of(plan: FloorPlan, seed: int, track: Track) -> tuple[int, float]:
    """Faces of the furniture that an exploration meets at first, and their length [m]."""
    env = ExploreEnv(plan, fitted_env(plan, track.trial.env, "auto"))
    env.reset(seed=seed, options={"plan": plan})
    faces = env.clutter.segments()
    across = faces[:, 2:] - faces[:, :2]
    length = np.hypot(across[:, 0], across[:, 1]).sum()
    return len(faces), round(float(length), 3)


def outline_hash(plan: FloorPlan) -> str:
    """SHA-256 of the free space, to a tenth of a millimetre, wherever its rings begin and however they run."""
    holes = [_canonical(ring) for ring in plan.free_space.interiors]
    holes.sort(key=lambda ring: ring.tolist())
    digest = hashlib.sha256()
    for ring in (_canonical(plan.free_space.exterior), *holes):
        digest.update(len(ring).to_bytes(4, "big"))
        digest.update(ring.astype(">i8").tobytes())
    return digest.hexdigest()


def _canonical(ring: LinearRing) -> IntArray:
    """A ring in whole grains, from its lowest corner on, towards the lower neighbour, shape (N, 2)."""
    points = np.asarray(ring.coords, dtype=np.float64)[:-1, :2]
    grains = np.rint(points / _GRAIN).astype(np.int64)
    lowest = np.lexsort((grains[:, 1], grains[:, 0]))[0]
    ahead = np.roll(grains, -lowest, axis=0)
    back = np.roll(ahead[::-1], 1, axis=0)
    return min(ahead, back, key=lambda turned: turned.tolist())

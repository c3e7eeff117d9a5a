"""Materials of a building's surfaces, as far as a laser scanner notices.

Materials belong to the place: they are drawn once for a building, from its own geometry and a seed, so that the same
pane is glass in every scan of every episode, and no other source of randomness moves. Each wall is cut into modules
of some metres, and a module may hold a pane of glass, a mirror, or a dark or shiny patch; a piece of furniture is
dark or shiny as a whole. Contacts know nothing of it: glass is as solid as a wall.
"""

import math
import zlib
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slamgym.core.config import CountOrZero, NonNegative, Settings, ShareBelowOne
from slamgym.core.errors import ConfigError
from slamgym.core.portable import exp
from slamgym.core.types import FloatArray, IntArray
from slamgym.sim.raycast import next_hit

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

PLAIN, GLASS, MIRROR = 0.0, 1.0, 2.0
"""Kinds of patches; dark and shiny ones are plain with a weak echo."""

_MODULE = 2.5  # [m] walls are cut into equal modules of at most this
# Of a module that is seen through: a gap between curtains, up to a French window; drawn evenly in its logarithm.
_NARROWEST_PANE, _WIDEST_PANE = 0.08, 0.9
_PANE_SHARE = (_WIDEST_PANE - _NARROWEST_PANE) / math.log(
    _WIDEST_PANE / _NARROWEST_PANE
)  # on average
_MIRROR_SHARE = 0.25
_DARK_SHARE = 0.5  # of a module, on average
_SHORTEST = 0.6  # [m] shorter walls have no pane and no mirror

# The echo of a dark or shiny surface against a white wall's, drawn evenly in its logarithm: black velvet and polished
# metal return less than a hundredth, dark varnish a third.
_WEAKEST_ECHO, _STRONGEST_ECHO = 0.003, 0.5

# A wall is an outer one if no other face of the plan lies within this behind it [m].
_THICKEST_WALL = 0.6

# What stands outside, before each outer pane, at most: posts of railings, plants, chairs, cars.
_THINGS_OUTSIDE = 12
_NEAREST_OUTSIDE, _FURTHEST_OUTSIDE = 0.3, 6.0  # [m]
_SMALLEST_OUTSIDE, _LARGEST_OUTSIDE = 0.03, 1.0  # [m]
# Behind it hedges, fences and other houses end the view, with gaps: pieces, their distance, and how far they reach to
# either side for each metre of it.
_BACKDROP = 5
_NEAREST_BACKDROP = 1.0  # [m]
_BACKDROP_REACH = 0.8
_BACKDROP_GAPS = 0.25  # share of its length

_FRAME_WIDTH = 0.08  # [m] of a door's frame


class SurfaceConfig(Settings, section="lidar.surfaces"):
    """Shares of a building that are hard to see for a scanner. The default is matt white everywhere and even."""

    glazing: ShareBelowOne = 0.0
    """Share of the outer walls' length that is glass at the scanner's height: gaps between curtains, French windows,
    glass doors. At most a third, with all else plain."""

    inner_glazing: ShareBelowOne = 0.0
    """The same of the inner walls: glass doors and partitions."""

    mirrors: ShareBelowOne = 0.0
    """Share of all walls' length that is a mirror."""

    dark: ShareBelowOne = 0.0
    """Share of walls and furniture that is dark or shiny and gives a weak echo."""

    roughness: NonNegative = 0.0
    """Standard deviation of a wall's evenness, smooth over a quarter of a metre [m]."""

    frames: NonNegative = 0.0
    """Most that the frames of doors and windows stand out of the wall [m]."""

    seed: CountOrZero = 0
    """Another seed gives the same buildings other materials."""

    def _check(self) -> None:
        for name in ("glazing", "inner_glazing"):
            if (
                getattr(self, name) / _PANE_SHARE
            ) + self.mirrors / _MIRROR_SHARE + self.dark / _DARK_SHARE > 1.0:
                raise ConfigError(
                    f"lidar.surfaces.{name}, mirrors and dark leave no plain wall; lower one of them"
                )


class Surfaces(NamedTuple):
    """The materials of a building's segments, as the kernels take them.

    Segments beyond the table are plain, so :func:`no_surfaces` suits every world.
    """

    first: IntArray
    """Where each segment's patches begin, shape (S + 1,)."""

    patches: FloatArray
    """Shape (P, 5): begin and end along the segment [m], kind, echo (1: a white wall), how far it stands out [m]."""

    outside: FloatArray
    """Segments that can be seen through glass only, shape (K, 4) as x0, y0, x1, y1 [m]."""

    num_walls: int
    """The first segments are the walls' faces."""

    seed: int
    """Seed of all that varies smoothly with the place."""

    roughness: float
    """Standard deviation of a wall's evenness [m]."""


def no_surfaces() -> Surfaces:
    """Matt white everywhere."""
    return Surfaces(np.zeros(1, dtype=np.int64), np.empty((0, 5)), np.empty((0, 4)), 0, 0, 0.0)


def make_surfaces(plan: "FloorPlan", furniture: FloatArray, config: SurfaceConfig) -> Surfaces:
    """Draw the materials of a building and of what stands in it: :func:`wall_surfaces`, :func:`furnished_surfaces`."""
    return furnished_surfaces(wall_surfaces(plan, config), furniture, config)


def wall_surfaces(plan: "FloorPlan", config: SurfaceConfig) -> Surfaces:
    """Draw the materials of an empty building.

    Args:
        plan: The building; its geometry and ``config.seed`` decide, so that its materials never change.
        config: How much of what.
    """
    if config == SurfaceConfig(seed=config.seed):
        return no_surfaces()
    walls = plan.segments()
    seed = zlib.crc32(np.ascontiguousarray(walls).tobytes(), config.seed)
    rng = np.random.default_rng(seed)
    outer = _outer(plan, walls)
    panes: list[list[tuple[float, ...]]] = []
    outside: list[FloatArray] = []
    for wall, is_outer in zip(walls, outer, strict=True):
        patches = _wall_patches(
            wall, config.glazing if is_outer else config.inner_glazing, config, rng
        )
        panes.append(_with_frames(wall, patches, plan, config, rng))
        if is_outer:
            outside += [
                _things_outside(wall, patch, plan, rng) for patch in patches if patch[2] == GLASS
            ]
    counts = [len(patches) for patches in panes]
    flat = [patch for patches in panes for patch in patches]
    return Surfaces(
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        patches=np.array(flat, dtype=np.float64).reshape(-1, 5),
        outside=np.vstack([np.empty((0, 4)), *outside]),
        num_walls=len(walls),
        seed=seed,
        roughness=config.roughness,
    )


def furnished_surfaces(walls: Surfaces, furniture: FloatArray, config: SurfaceConfig) -> Surfaces:
    """Add the materials of furniture: a patch over the whole of each segment of the pieces that are dark or shiny.

    Args:
        walls: Of the empty building.
        furniture: Outlines of what stands in it, shape (F, 4) [m]; each closed chain of segments is a piece.
        config: How much of it is dark.
    """
    if len(furniture) == 0 or walls.num_walls == 0:
        return walls
    begins = np.ones(len(furniture), np.bool_)
    begins[1:] = (furniture[:-1, 2:] != furniture[1:, :2]).any(axis=1)
    # Its own stream: moving a chair doesn't change the walls.
    draws = np.random.default_rng([walls.seed, 1]).random((int(begins.sum()), 2)).tolist()
    by_piece = np.array(
        [_echo(strength) if draw < config.dark else 1.0 for draw, strength in draws]
    )
    echoes = by_piece[np.cumsum(begins) - 1]
    is_dark = echoes < 1.0
    patches = np.zeros((int(is_dark.sum()), 5))
    patches[:, 1], patches[:, 3] = math.inf, echoes[is_dark]
    return walls._replace(
        first=np.append(walls.first, walls.first[-1] + np.cumsum(is_dark)),
        patches=np.vstack([walls.patches, patches]),
    )


def _outer(plan: "FloorPlan", walls: FloatArray) -> list[bool]:
    """True if there is nothing behind each wall: no other room within the thickness of a wall."""
    import shapely

    middles = 0.5 * (walls[:, :2] + walls[:, 2:])
    along = walls[:, 2:] - walls[:, :2]
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    probes = middles + 0.01 * normals
    inwards = shapely.contains_xy(plan.free_space, probes[:, 0], probes[:, 1])
    normals[inwards] *= -1.0
    return [
        next_hit(x, y, nx, ny, 1e-6, walls, _THICKEST_WALL)[1] < 0
        for (x, y), (nx, ny) in zip(middles.tolist(), normals.tolist(), strict=True)
    ]


def _wall_patches(
    wall: FloatArray, glazing: float, config: SurfaceConfig, rng: np.random.Generator
) -> list[tuple[float, ...]]:
    """Glass, mirrors and dark patches of one wall, in order along it."""
    length = math.hypot(wall[2] - wall[0], wall[3] - wall[1])
    modules = math.ceil(length / _MODULE)
    size = length / modules
    chances = np.array(
        [glazing / _PANE_SHARE, config.mirrors / _MIRROR_SHARE, config.dark / _DARK_SHARE]
    )
    if length < _SHORTEST:
        chances[:2] = 0.0
    ends = np.cumsum(chances)
    patches: list[tuple[float, ...]] = []
    for module in range(modules):
        draw, at, share, echo = rng.random(4).tolist()
        kind = int(np.searchsorted(ends, draw, side="right"))
        if kind == 3:
            continue
        pane = _NARROWEST_PANE * (_WIDEST_PANE / _NARROWEST_PANE) ** share
        taken = (pane, _MIRROR_SHARE, 2.0 * _DARK_SHARE * share)[kind]
        begin = (module + at * (1.0 - taken)) * size
        material = ((GLASS, 1.0), (MIRROR, 1.0), (PLAIN, _echo(echo)))[kind]
        patches.append((begin, begin + taken * size, *material, 0.0))
    return patches


def _echo(draw: float) -> float:
    """A weak echo from a draw in [0, 1)."""
    return math.exp(math.log(_WEAKEST_ECHO) + draw * math.log(_STRONGEST_ECHO / _WEAKEST_ECHO))


def _with_frames(
    wall: FloatArray,
    patches: list[tuple[float, ...]],
    plan: "FloorPlan",
    config: SurfaceConfig,
    rng: np.random.Generator,
) -> list[tuple[float, ...]]:
    """Add the frames of windows, and of doors whose jambs lie on the wall; where two overlap, the first counts."""
    if config.frames == 0.0:
        return patches
    frames: list[tuple[float, ...]] = []
    for begin, end, kind, *_ in patches:
        if kind == GLASS:
            depth = float(rng.uniform(0.0, config.frames))
            frames += [
                (at - _FRAME_WIDTH, at, PLAIN, 1.0, depth) for at in (begin, end + _FRAME_WIDTH)
            ]
    length = float(np.hypot(*(wall[2:] - wall[:2])))
    direction = (wall[2:] - wall[:2]) / length
    for jamb in (point for door in plan.doors for point in (door.start, door.end)):
        x, y = (np.asarray(jamb) - wall[:2]).tolist()
        along, across = x * direction[0] + y * direction[1], x * direction[1] - y * direction[0]
        if abs(across) < 0.2 and -0.2 < along < length + 0.2:
            depth = float(rng.uniform(0.0, config.frames))
            frames.append((along - _FRAME_WIDTH, along + _FRAME_WIDTH, PLAIN, 1.0, depth))
    return patches + frames


def _things_outside(
    wall: FloatArray, pane: tuple[float, ...], plan: "FloorPlan", rng: np.random.Generator
) -> FloatArray:
    """Some short walls before a pane, seen from within the building, shape (K, 4) [m]."""
    import shapely

    along = (wall[2:] - wall[:2]) / np.hypot(*(wall[2:] - wall[:2]))
    out = np.array([along[1], -along[0]])
    middle = wall[:2] + 0.5 * (pane[0] + pane[1]) * along
    if shapely.contains_xy(plan.free_space, *(middle + 0.01 * out)):
        out = -out
    number = int(rng.integers(_THINGS_OUTSIDE + 1))
    away = _NEAREST_OUTSIDE * exp(
        math.log(_FURTHEST_OUTSIDE / _NEAREST_OUTSIDE) * rng.random(number)
    )
    aside = (0.5 + 0.5 * away) * rng.normal(0.0, 1.0, number)
    half = 0.5 * _SMALLEST_OUTSIDE * (_LARGEST_OUTSIDE / _SMALLEST_OUTSIDE) ** rng.random(number)
    far = _NEAREST_BACKDROP * (_FURTHEST_OUTSIDE / _NEAREST_BACKDROP) ** rng.random()
    reach = _BACKDROP_REACH * far
    away = np.append(away, far + rng.normal(0.0, 0.1 * far, _BACKDROP))
    aside = np.append(aside, reach * np.linspace(-1.0, 1.0, _BACKDROP))
    half = np.append(half, (1.0 - _BACKDROP_GAPS) * np.full(_BACKDROP, reach / (_BACKDROP - 1)))
    angles = rng.normal(0.0, 0.4, number + _BACKDROP)
    directions = np.cos(angles)[:, None] * along + np.sin(angles)[:, None] * out
    centres = middle + away[:, None] * out + aside[:, None] * along
    ends = half[:, None] * directions
    return np.hstack([centres - ends, centres + ends])

"""Materials of a building's surfaces, as far as a laser scanner notices.

Materials belong to the place: they are drawn once for a building, from its own geometry and a seed, so that the same
pane is glass in every scan of every episode, and no other source of randomness moves. Each wall is cut into modules
of some metres, and a module may hold a pane of glass, a mirror, or a dark or shiny patch; a piece of furniture is
dark or shiny as a whole. Contacts know nothing of it: glass is as solid as a wall.
"""

import math
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from slamgym.core.config import CountOrZero, NonNegative, Settings, ShareBelowOne
from slamgym.core.errors import ConfigError
from slamgym.core.portable import exp
from slamgym.core.types import FloatArray, IntArray
from slamgym.sim.raycast import next_hit

if TYPE_CHECKING:
    from slamgym.cad.floorplan import FloorPlan

PLAIN = 0.0
"""Kind of a patch of wall; dark and shiny patches are plain with a weak echo."""
GLASS = 1.0
"""Kind of a patch that beams pass."""
MIRROR = 2.0
"""Kind of a patch that reflects beams."""

_MODULE = 2.5
"""Walls are cut into equal modules of at most this length [m]."""
_NARROWEST_PANE = 0.08
"""Least share of a module that is seen through: a gap between curtains. Shares are even in their logarithm."""
_WIDEST_PANE = 0.9
"""Largest share of a module that is seen through: a French window."""
_PANE_SHARE = (_WIDEST_PANE - _NARROWEST_PANE) / math.log(_WIDEST_PANE / _NARROWEST_PANE)
"""Share of a module that is seen through, on average."""
_MIRROR_SHARE = 0.25
"""Share of a module that a mirror covers."""
_DARK_SHARE = 0.5
"""Share of a module that a dark patch covers, on average."""
_SHORTEST = 0.6
"""Shorter walls have no pane and no mirror [m]."""

_WEAKEST_ECHO = 0.003
"""Weakest echo of a dark or shiny surface against a white wall's: black velvet and polished metal."""
_STRONGEST_ECHO = 0.5
"""Strongest echo of a dark surface against a white wall's: dark varnish returns a third."""

_THICKEST_WALL = 0.6
"""A wall is an outer one if no other face of the plan lies within this behind it [m]."""

_THINGS_OUTSIDE = 12
"""So many things stand before each outer pane at most: posts of railings, plants, chairs, cars."""
_NEAREST_OUTSIDE = 0.3
"""Least distance of a thing outside from its pane [m]."""
_FURTHEST_OUTSIDE = 6.0
"""Largest distance of a thing outside from its pane [m]."""
_SMALLEST_OUTSIDE = 0.03
"""Least width of a thing outside [m]."""
_LARGEST_OUTSIDE = 1.0
"""Largest width of a thing outside [m]."""
_BACKDROP = 5
"""So many pieces of hedges, fences and other houses end the view outside."""
_NEAREST_BACKDROP = 1.0
"""Least distance of what ends the view from its pane [m]."""
_BACKDROP_REACH = 0.8
"""What ends the view reaches so far to either side for each metre of its distance [m]."""
_BACKDROP_GAPS = 0.25
"""Share of gaps in what ends the view."""

_FRAME_WIDTH = 0.08
"""Width of the frame of a door or window [m]."""


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
        for name, glazing in (("glazing", self.glazing), ("inner_glazing", self.inner_glazing)):
            with_pane = glazing / _PANE_SHARE
            with_mirror = self.mirrors / _MIRROR_SHARE
            with_dark = self.dark / _DARK_SHARE
            if with_pane + with_mirror + with_dark > 1.0:
                raise ConfigError(
                    f"lidar.surfaces.{name}, mirrors and dark leave no plain wall; lower one of them"
                )


class Patch(NamedTuple):
    """A part of a wall with a material of its own, or a frame that stands out of it."""

    begin: float
    """Along the wall [m]."""
    end: float
    """Along the wall [m]."""
    kind: float
    echo: float
    """1: a white wall."""
    depth: float
    """How far it stands out [m]."""


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
    patches: list[Patch] = []
    first = [0]
    outside: list[FloatArray] = []
    for wall, is_outer in zip(walls, _outer(plan, walls), strict=True):
        glazing = config.glazing if is_outer else config.inner_glazing
        own = _wall_patches(wall, glazing, config, rng)
        patches += own
        patches += _frames(wall, own, plan, config, rng)
        first.append(len(patches))
        if is_outer:
            panes = [patch for patch in own if patch.kind == GLASS]
            outside += [_things_outside(wall, pane, plan, rng) for pane in panes]
    return Surfaces(
        first=np.array(first, np.int64),
        patches=np.array(patches, dtype=np.float64).reshape(-1, 5),
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
    rng = np.random.default_rng([walls.seed, 1])
    by_piece = []
    for draw, strength in rng.random((int(begins.sum()), 2)).tolist():
        by_piece.append(_echo(strength) if draw < config.dark else 1.0)
    piece_of_segment = np.cumsum(begins) - 1
    echoes = np.array(by_piece)[piece_of_segment]
    is_dark = echoes < 1.0
    patches = np.zeros((int(is_dark.sum()), 5))
    patches[:, 1] = math.inf
    patches[:, 3] = echoes[is_dark]
    return walls._replace(
        first=np.append(walls.first, walls.first[-1] + np.cumsum(is_dark)),
        patches=np.vstack([walls.patches, patches]),
    )


def _outer(plan: "FloorPlan", walls: FloatArray) -> list[bool]:
    """True if there is nothing behind each wall: no other room within the thickness of a wall."""
    import shapely

    starts = walls[:, :2]
    ends = walls[:, 2:]
    middles = 0.5 * (starts + ends)
    along = ends - starts
    lengths = np.hypot(along[:, 0], along[:, 1])
    outwards = np.column_stack([-along[:, 1], along[:, 0]]) / lengths[:, None]
    probes = middles + 0.01 * outwards
    inwards = shapely.contains_xy(plan.free_space, probes[:, 0], probes[:, 1])
    outwards[inwards] *= -1.0
    is_outer = []
    for middle, outward in zip(middles.tolist(), outwards.tolist(), strict=True):
        x, y = middle
        ux, uy = outward
        _, hit = next_hit(x, y, ux, uy, 1e-6, walls, _THICKEST_WALL)
        is_outer.append(hit < 0)
    return is_outer


def _wall_patches(
    wall: FloatArray, glazing: float, config: SurfaceConfig, rng: np.random.Generator
) -> list[Patch]:
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
    patches: list[Patch] = []
    for module in range(modules):
        draw, at, share, echo = rng.random(4).tolist()
        kind = int(np.searchsorted(ends, draw, side="right"))
        if kind == 3:
            continue
        pane = _NARROWEST_PANE * (_WIDEST_PANE / _NARROWEST_PANE) ** share
        taken = (pane, _MIRROR_SHARE, 2.0 * _DARK_SHARE * share)[kind]
        begin = (module + at * (1.0 - taken)) * size
        end = begin + taken * size
        material = (GLASS, MIRROR, PLAIN)[kind]
        strength = _echo(echo) if material == PLAIN else 1.0
        patches.append(Patch(begin, end, material, strength, 0.0))
    return patches


def _echo(draw: float) -> float:
    """A weak echo from a draw in [0, 1)."""
    return math.exp(math.log(_WEAKEST_ECHO) + draw * math.log(_STRONGEST_ECHO / _WEAKEST_ECHO))


def _frames(
    wall: FloatArray,
    patches: list[Patch],
    plan: "FloorPlan",
    config: SurfaceConfig,
    rng: np.random.Generator,
) -> list[Patch]:
    """The frames of windows, and of doors whose jambs lie on the wall; of patches that overlap the first counts."""
    if config.frames == 0.0:
        return []
    frames: list[Patch] = []
    for patch in patches:
        if patch.kind == GLASS:
            depth = float(rng.uniform(0.0, config.frames))
            frames.append(Patch(patch.begin - _FRAME_WIDTH, patch.begin, PLAIN, 1.0, depth))
            after = patch.end + _FRAME_WIDTH
            frames.append(Patch(after - _FRAME_WIDTH, after, PLAIN, 1.0, depth))
    start = wall[:2]
    along_wall = wall[2:] - start
    length = float(np.hypot(*along_wall))
    direction = along_wall / length
    jambs: list[Sequence[float]] = []
    for door in plan.doors:
        jambs += [door.start, door.end]
    for jamb in jambs:
        x, y = (np.asarray(jamb) - start).tolist()
        along = x * direction[0] + y * direction[1]
        across = x * direction[1] - y * direction[0]
        if abs(across) < 0.2 and -0.2 < along < length + 0.2:
            depth = float(rng.uniform(0.0, config.frames))
            frames.append(Patch(along - _FRAME_WIDTH, along + _FRAME_WIDTH, PLAIN, 1.0, depth))
    return frames


def _things_outside(
    wall: FloatArray, pane: Patch, plan: "FloorPlan", rng: np.random.Generator
) -> FloatArray:
    """Some short walls before a pane, seen from within the building, shape (K, 4) [m]."""
    import shapely

    start = wall[:2]
    along = (wall[2:] - start) / np.hypot(*(wall[2:] - start))
    out = np.array([along[1], -along[0]])
    middle = start + 0.5 * (pane.begin + pane.end) * along
    probe = middle + 0.01 * out
    if shapely.contains_xy(plan.free_space, probe[0], probe[1]):
        out = -out
    near = _draw_things(rng)
    far = _draw_backdrop(rng)
    away = np.append(near.away, far.away)
    aside = np.append(near.aside, far.aside)
    half = np.append(near.half, far.half)
    angles = rng.normal(0.0, 0.4, len(away))
    directions = np.outer(np.cos(angles), along) + np.outer(np.sin(angles), out)
    centres = middle + np.outer(away, out) + np.outer(aside, along)
    ends = half[:, None] * directions
    return np.hstack([centres - ends, centres + ends])


class _Outside(NamedTuple):
    """Things before a pane, each array of shape (N,) [m]."""

    away: FloatArray
    """Distance from the wall."""
    aside: FloatArray
    """From the middle of the pane, along the wall."""
    half: FloatArray
    """Half the width."""


def _draw_things(rng: np.random.Generator) -> _Outside:
    """Draw what stands outside."""
    number = int(rng.integers(_THINGS_OUTSIDE + 1))
    distances = math.log(_FURTHEST_OUTSIDE / _NEAREST_OUTSIDE)
    away = _NEAREST_OUTSIDE * exp(distances * rng.random(number))
    aside = (0.5 + 0.5 * away) * rng.normal(0.0, 1.0, number)
    sizes = _LARGEST_OUTSIDE / _SMALLEST_OUTSIDE
    half = 0.5 * _SMALLEST_OUTSIDE * sizes ** rng.random(number)
    return _Outside(away, aside, half)


def _draw_backdrop(rng: np.random.Generator) -> _Outside:
    """Draw what ends the view outside: hedges, fences and other houses, with gaps."""
    distances = _FURTHEST_OUTSIDE / _NEAREST_BACKDROP
    far = _NEAREST_BACKDROP * distances ** rng.random()
    reach = _BACKDROP_REACH * far
    away = far + rng.normal(0.0, 0.1 * far, _BACKDROP)
    aside = reach * np.linspace(-1.0, 1.0, _BACKDROP)
    half_piece = reach / (_BACKDROP - 1)
    half = (1.0 - _BACKDROP_GAPS) * np.full(_BACKDROP, half_piece)
    return _Outside(away, aside, half)

"""How a pair is changed before it is learned from: motions of both images, and damage to the SLAM map.

The damage is what real robots do: real maps have more unknown, gaps in walls, double walls and noise than clean
simulation, and a quarter of them are turned.
"""

import math

import cv2
import numpy as np

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray
from slamgym.gan.data import window_corner
from slamgym.metrics.maps import resample_slam
from slamgym.metrics.wall_direction import transformed

ZOOM = 0.15
"""Images are enlarged by up to this share, or shrunk by it."""
RESAMPLED = 0.5
"""Share of the samples that are zoomed and turned, which moves walls by half a pixel at random; the others stay on
their grid, as maps in use do."""
ROOM_TO_TURN = 1.42
"""Windows are cut larger by this, so that a turn about their middle takes nothing from beyond them."""
ROTATED = 0.3
"""Share of the resampled windows that are turned by any angle."""
DAMAGE_PROBABILITY = 0.2
"""Probability of each kind of damage: clean maps shall stay common."""
TURN_DEG = 0.5
"""Standard deviation of a turn of the SLAM map [deg]; the published code turns it by up to 3."""
WOBBLE_PX = 1.5
"""Largest amplitude of a smooth random distortion of the SLAM map [px]: more drift than the data has."""
WALL_DROPOUT = 0.2
"""Largest share of the walls that are erased in blobs."""
UNKNOWN_BLOBS = 0.08
"""Largest share of the image that becomes unknown in blobs."""
SALT_NOISE = 0.004
"""Largest share of the pixels that get a value at random, mostly occupied."""
DOUBLED_PX = 6.0
"""Largest shift of a part that is drawn twice, as after a loop that was closed late, along each axis [px]."""
DOUBLED_DEG = 2.0
"""Largest turn of such a part [deg]."""
COARSEST = 2.0
"""Cells are made coarser by up to this factor."""
BLOB_CELLS = 24
"""Cells a side of the grid of noise that blobs come from."""
WOBBLE_CELLS = 6
"""Cells a side of the grid of noise that distortions come from."""
NEAREST_CUT = 0.1
"""Least distance of a cut from the image's centre, in sides."""
FARTHEST_CUT = 0.45
"""Largest such distance."""


def augment(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """Cut a window out of a pair, move it, and damage its SLAM map.

    Args:
        cad: (S, S), or (S, S, C) several images that move together.
        slam: (S, S).
        side: Side of the result [px]; images that aren't larger keep theirs.
        rng: Source of the draws.

    Returns:
        The window of both; the inputs stay as they are.
    """
    if side < cad.shape[0]:
        room = min(cad.shape[0], round(ROOM_TO_TURN * side))
        cad, slam = _cut_window(cad, slam, room, rng)
    both, own = _draw_motions(cad.shape[0], rng)
    cad = _moved(cad, both, cv2.INTER_LINEAR, OCCUPIED)
    if rng.random() < DAMAGE_PROBABILITY:
        amplitude_px = rng.uniform(0.0, WOBBLE_PX)
        slam = _wobbled(slam, own, amplitude_px, rng)
    else:
        slam = _moved(slam, own, cv2.INTER_NEAREST, UNKNOWN)
    for damage in (_doubled, _with_gaps, _forgotten, _cut_off, _speckled, _coarsened):
        if rng.random() < DAMAGE_PROBABILITY:
            slam = damage(slam, rng)
    return _middle(cad, side), _middle(slam, side)


def _middle(image: ByteArray, side: int) -> ByteArray:
    """The middle of an image that is larger than this side [px]."""
    if side >= image.shape[0]:
        return image
    start = (image.shape[0] - side) // 2
    end = start + side
    return image[start:end, start:end]


def _cut_window(
    cad: ByteArray, slam: ByteArray, side: int, rng: np.random.Generator
) -> tuple[ByteArray, ByteArray]:
    """A window of both images about a random place of what the SLAM map shows."""
    known = np.flatnonzero(slam != UNKNOWN)
    at = slam.size // 2
    if known.size > 0:
        at = int(known[rng.integers(known.size)])
    place = divmod(at, slam.shape[1])
    row, col = window_corner(slam, side, place)
    window = slice(row, row + side), slice(col, col + side)
    return cad[window], slam[window]


def _draw_motions(side: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The motion of the CAD map and that of the SLAM map, which is turned a little more: 3 x 3 on (col, row)."""
    if rng.random() >= RESAMPLED:
        return np.eye(3), np.eye(3)
    angle = 0.0
    if rng.random() < ROTATED:
        angle = rng.uniform(-45.0, 45.0)
    strength = rng.uniform(-1.0, 1.0)
    zoom = math.exp(strength * math.log1p(ZOOM))
    both = _about_centre(side, angle, zoom)
    turn = _about_centre(side, rng.normal(0.0, TURN_DEG))
    return both, turn @ both


def _about_centre(side: int, angle_deg: float, zoom: float = 1.0) -> np.ndarray:
    """A turn and zoom as a 3 x 3 matrix on (col, row)."""
    centre = 0.5 * (side - 1)
    turn = cv2.getRotationMatrix2D((centre, centre), angle_deg, zoom)
    return np.vstack([turn, [0.0, 0.0, 1.0]])


def _moved(image: ByteArray, motion: np.ndarray, method: int, fill: int) -> ByteArray:
    if np.array_equal(motion, np.eye(3)):
        return image
    there = transformed(image, motion[:2], fill, method)
    return np.asarray(there, dtype=np.uint8)


def _wobbled(
    image: ByteArray, motion: np.ndarray, amplitude_px: float, rng: np.random.Generator
) -> ByteArray:
    """Move, and distort smoothly by vectors of the given standard deviation."""
    side = image.shape[0]
    noise = rng.normal(0.0, amplitude_px, (WOBBLE_CELLS, WOBBLE_CELLS, 2))
    coarse = noise.astype(np.float32)
    field = cv2.resize(coarse, (side, side), interpolation=cv2.INTER_CUBIC)
    pixels = np.arange(side, dtype=np.float32)
    cols, rows = np.meshgrid(pixels, pixels)
    to_col, to_row, _ = np.linalg.inv(motion)
    from_cols = to_col[0] * cols + to_col[1] * rows + to_col[2] + field[..., 0]
    from_rows = to_row[0] * cols + to_row[1] * rows + to_row[2] + field[..., 1]
    warped = cv2.remap(
        image,
        from_cols.astype(np.float32),
        from_rows.astype(np.float32),
        cv2.INTER_NEAREST,
        borderValue=UNKNOWN,
    )
    return np.asarray(warped, dtype=np.uint8)


def _doubled(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Draw the part beyond a line a second time, displaced."""
    side = slam.shape[0]
    shift = rng.uniform(-DOUBLED_PX, DOUBLED_PX, 2)
    angle_deg = rng.uniform(-DOUBLED_DEG, DOUBLED_DEG)
    motion = _about_centre(side, angle_deg)
    motion[:2, 2] += shift
    again = _moved(slam, motion, cv2.INTER_NEAREST, UNKNOWN)
    new_floor = (again == FREE) & (slam == UNKNOWN)
    adds = (again == OCCUPIED) | new_floor
    beyond = _half_plane(side, rng)
    return np.where(adds & beyond, again, slam)


def _with_gaps(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Erase walls in blobs."""
    share = rng.uniform(0.0, WALL_DROPOUT)
    blobs = _blobs(slam.shape[0], share, rng)
    is_wall = slam == OCCUPIED
    return _erased(slam, is_wall & blobs)


def _forgotten(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Make blobs unknown."""
    share = rng.uniform(0.0, UNKNOWN_BLOBS)
    return _erased(slam, _blobs(slam.shape[0], share, rng))


def _cut_off(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Make all beyond a line unknown."""
    return _erased(slam, _half_plane(slam.shape[0], rng))


def _erased(slam: ByteArray, where: BoolArray) -> ByteArray:
    return np.where(where, UNKNOWN, slam).astype(np.uint8)


def _speckled(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Salt noise: give pixels here and there a value at random."""
    share = rng.uniform(0.0, SALT_NOISE)
    count = int(share * slam.size)
    rows, cols = rng.integers(0, slam.shape[0], (2, count))
    speckled = slam.copy()
    # Mostly stray hits; a few holes and rays.
    speckled[rows, cols] = rng.choice([OCCUPIED, OCCUPIED, FREE, UNKNOWN], count)
    return speckled


def _coarsened(slam: ByteArray, rng: np.random.Generator) -> ByteArray:
    """The map as one of coarser cells shows it."""
    side = round(slam.shape[0] / rng.uniform(1.0, COARSEST))
    coarse = resample_slam(slam, (side, side))
    return resample_slam(coarse, slam.shape)


def _blobs(side: int, share: float, rng: np.random.Generator) -> BoolArray:
    """Random smooth blobs that cover about this share of the square."""
    noise = rng.random((BLOB_CELLS, BLOB_CELLS), dtype=np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 0.8)
    uncovered = max(0.0, 1.0 - share)
    level = float(np.quantile(smooth, uncovered))
    fine = cv2.resize(smooth, (side, side), interpolation=cv2.INTER_LINEAR)
    return fine > level


def _half_plane(side: int, rng: np.random.Generator) -> BoolArray:
    """All beyond a random line."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    distance = rng.uniform(NEAREST_CUT, FARTHEST_CUT) * side
    offsets = np.arange(side, dtype=np.float32) - 0.5 * (side - 1)
    along_cols = math.cos(angle) * offsets[None, :]
    along_rows = math.sin(angle) * offsets[:, None]
    return along_cols + along_rows > distance

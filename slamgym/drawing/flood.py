"""How much floor lies on both sides of a line, and how much of it another way joins: a flood of limited reach."""

from typing import Any, NamedTuple

import numpy as np

from slamgym.core.jit import assign, kernel
from slamgym.core.types import BoolArray, FloatArray, GridFrame, IntArray

REACHES = (1.6, 3.2, 4.8)
"""The flood is looked at after so much walking [m]."""
SEAL = 0.1
"""A line is closed so far beyond its ends, for outlines are straighter than cells [m]. Without it room
F1 of 57 real maps is lower by 0.008 +- 0.005."""
HALF_LINE = 0.71
"""Half of a line's thickness: no step to one of eight neighbours leaps over it [cells]."""
BESIDE_LINE = 1.5
"""The flood begins so far to its sides [cells]."""
WORD = 56
"""Cells of a row that one number holds, a bit each, the first the lowest: whole bytes, none of them the sign's."""


class Flood(NamedTuple):
    """What is reached on both sides of N lines within each of the R :data:`REACHES`."""

    area: FloatArray  # (N, 2, R) [m2]
    widest: FloatArray  # (N, 2, R): largest clearance of what is reached [m]
    shared: FloatArray  # (N, R): reached from both sides [m2]


def limited_flood(
    lines: FloatArray, free: BoolArray, clearance: FloatArray, frame: GridFrame
) -> Flood:
    """Walk away from closed lines to both sides.

    Args:
        lines: (N, 2, 2) [m].
        free: Where one may walk, (H, W).
        clearance: Distance to what isn't free, (H, W) [m].
        frame: Where the cells lie.
    """
    cell = frame.resolution
    top_left = np.array([frame.origin_x, frame.origin_y + frame.height_px * cell])
    columns_and_rows = (lines - top_left) * (1.0, -1.0) / cell + 0.5  # of the padded pictures
    steps = np.round(np.array(REACHES) / cell).astype(np.int64)
    margins = ((1, 1), (1, WORD - (free.shape[1] + 1) % WORD))  # to whole words
    clear = np.pad(clearance, margins)
    bits = np.pad(free, margins).reshape(len(clear), -1, WORD)
    octets = np.pad(np.packbits(bits, axis=2, bitorder="little"), ((0, 0), (0, 0), (0, 1)))
    words = octets.view(np.int64)[..., 0]
    clearest = clear.reshape(len(clear), -1, WORD).max(axis=2)
    count, widest, shared = _flood_all(
        np.ascontiguousarray(columns_and_rows), words, clear, clearest, steps, SEAL / cell
    )
    area = count.astype(np.float64) * cell**2
    both = shared.astype(np.float64) * cell**2
    return Flood(area, widest, both)


@kernel
def _flood_all(
    lines: FloatArray,
    free: IntArray,
    clearance: FloatArray,
    clearest: FloatArray,
    steps: IntArray,
    seal: float,
) -> tuple[IntArray, FloatArray, IntArray]:
    """The floods of all lines; the pictures have a border of a cell at least, and all lengths are in cells.

    Each goes through a window that holds all it can reach: so small a part of a map stays in the processor's cache.
    """
    number, last = len(lines), len(steps)
    count = np.zeros((number, 2, last), np.int64)
    widest = np.zeros((number, 2, last))
    shared = np.zeros((number, last), np.int64)
    margin = steps[-1] + int(HALF_LINE + BESIDE_LINE) + 2
    side = int(np.abs(lines[:, 1] - lines[:, 0]).max()) + 2 * margin + 3
    wide = side // WORD + 2
    for n in range(number):
        top = max(0, int(lines[n, :, 1].min()) - margin)
        left = max(0, int(lines[n, :, 0].min()) - margin) // WORD
        line = lines[n] - np.array([left * WORD, top], np.float64)
        window = free[top : top + side, left : left + wide].copy()
        _close(line, window, seal)
        near = clearance[top : top + side, left * WORD : (left + wide) * WORD]
        bounds = clearest[top : top + side, left : left + wide]
        unreached = np.empty((2, last, window.size), np.int64)
        for k in range(2):
            _walk(line, k, window, steps, unreached[k])
            wide_so_far = 0.0
            for r in range(last):
                count[n, k, r] = _count(window, unreached[k, r], unreached[k, r])
                wide_so_far = _find_widest(near, bounds, window, unreached[k, r], wide_so_far)
                widest[n, k, r] = wide_so_far
        for r in range(last):
            shared[n, r] = _count(window, unreached[0, r], unreached[1, r])
    return count, widest, shared


@kernel
def _count(free: IntArray, one: IntArray, other: IntArray) -> int:
    """How many free cells are in neither of two: sums of pairs of bits, of pairs of these, and so on."""
    total = 0
    for i in range(free.size):
        word = free.flat[i] & ~one[i] & ~other[i]
        twos = word - ((word >> 1) & 0x5555555555555555)
        upper = (twos >> 2) & 0x3333333333333333
        fours = (twos & 0x3333333333333333) + upper
        eights = (fours + (fours >> 4)) & 0x0F0F0F0F0F0F0F0F
        total += (eights * 0x0101010101010101) >> 56
    return total


@kernel
def _find_widest(
    clearance: FloatArray, clearest: FloatArray, free: IntArray, unreached: IntArray, least: float
) -> float:
    """The largest clearance of cells that were reached, ``least`` at least; ``clearest`` is that of whole words."""
    rows, cols = free.shape
    for row in range(rows):
        for at in range(cols):
            word = free[row, at] & ~unreached[row * cols + at]
            if word and clearest[row, at] > least:
                for bit in range(WORD):
                    if (word >> bit) & 1:
                        least = max(least, clearance[row, at * WORD + bit])
    return least


@kernel
def _place(line: FloatArray, length: float, row: Any, col: Any) -> tuple[float, float]:
    """How far along a line of this length and aside of it a cell lies."""
    x, y = line[0]
    across = line[1, 0] - x
    down = line[1, 1] - y
    along = ((col - x) * across + (row - y) * down) / length
    aside = ((row - y) * across - (col - x) * down) / length
    return along, aside


@kernel
def _close(line: FloatArray, free: IntArray, seal: float) -> None:
    """Take the cells of a line from the free ones."""
    length = np.hypot(line[1, 0] - line[0, 0], line[1, 1] - line[0, 1])
    margin = HALF_LINE + seal + 1.0
    rows = _stretch(line[:, 1], margin, free.shape[0])
    cols = _stretch(line[:, 0], margin, free.shape[1] * WORD)
    for row in range(*rows):
        for col in range(*cols):
            along, aside = _place(line, length, row, col)
            if abs(aside) <= HALF_LINE and -seal <= along <= length + seal:
                free[row, col // WORD] &= ~(1 << col % WORD)


@kernel
def _begin(line: FloatArray, side: int, free: IntArray, reached: IntArray) -> tuple[int, int]:
    """Set the bits of the free cells right beside a line; returns the rows in which they may be."""
    cols = free.shape[1]
    length = np.hypot(line[1, 0] - line[0, 0], line[1, 1] - line[0, 1])
    margin = HALF_LINE + BESIDE_LINE + 1.0
    rows = _stretch(line[:, 1], margin, free.shape[0])
    for row in range(*rows):
        for col in range(*_stretch(line[:, 0], margin, cols * WORD)):
            along, aside = _place(line, length, row, col)
            is_side = (aside > 0.0) == (side == 1)
            is_beside = HALF_LINE < abs(aside) <= HALF_LINE + BESIDE_LINE
            if is_side and is_beside and 0.0 <= along <= length:
                at = col // WORD
                bit = 1 << col % WORD
                reached[row * cols + at] |= free[row, at] & bit
    return rows


@kernel
def _stretch(places: FloatArray, margin: float, end: int) -> tuple[int, int]:
    """The first cell round two places, and that behind the last, within the picture's border."""
    return max(1, int(places.min() - margin)), min(end - 1, int(places.max() + margin) + 1)


@kernel
def _walk(
    line: FloatArray, side: int, free: IntArray, steps: IntArray, unreached: IntArray
) -> None:
    """Flood to four neighbours and to eight by turns: circles become octagons, 6 % off at most.

    ``unreached``, (R, words): what hasn't been after each number of steps.
    """
    rows, cols = free.shape
    now = np.zeros(free.size, np.int64)  # reached in the last step
    following = np.zeros(free.size, np.int64)
    sideways = np.zeros(free.size, np.int64)
    top, bottom = _begin(line, side, free, now)
    left = unreached[0]
    for i in range(free.size):
        left[i] = free.flat[i] & ~now[i]
    done = 0
    for level in range(1, steps[-1] + 1):
        top = max(1, top - 1)
        bottom = min(rows - 1, bottom + 1)
        first, end = top * cols, bottom * cols
        _spread(now[first - 1 : end + 1], sideways[first:end])
        others = now if level % 2 else sideways
        around = others[first - cols : end + cols]
        _grow(around, sideways[first:end], left[first:end], following[first:end])
        now, following = following, now
        if level == steps[done] and done + 1 < len(steps):
            done += 1
            assign(left, unreached[done])
            left = unreached[done]


@kernel
def _spread(now: IntArray, out: IntArray) -> None:
    """Bits of a stretch that are set, and those to their left and right; ``now`` has a word more at both ends."""
    before = now[:-2]
    here = now[1:-1]
    behind = now[2:]
    for i in range(len(out)):
        to_right = (here[i] << 1) | (before[i] >> WORD - 1)
        to_left = (here[i] >> 1) | (behind[i] << WORD - 1)
        out[i] = here[i] | to_right | to_left


@kernel
def _grow(around: IntArray, own: IntArray, left: IntArray, out: IntArray) -> None:
    """Bits that are set in their own row or one beside it, if they are left, which they are no more.

    ``around`` has a row more at both ends.
    """
    below = around[len(around) - len(own) :]
    for i in range(len(own)):
        out[i] = (own[i] | around[i] | below[i]) & left[i]
        left[i] ^= out[i]

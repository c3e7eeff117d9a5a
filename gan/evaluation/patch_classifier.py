"""A convolutional network as the learner of the two-sample test between sets of SLAM maps, on patches of them.

Whole maps differ in size and in what they show; patches at native cells show how walls, rays and clutter are drawn.
A map's score is the mean over its patches; maps of one building are never on both sides.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, BoolArray, ByteArray, FloatArray, IntArray
from slamgym.metrics.maps import free_boundary

PATCH_SIDE = 64
"""Side of a patch [cells]; a multiple of 32."""
PER_MAP = 32
"""Patches of a map, each around a random cell of the border of its free space."""
PER_KIND = 512
"""Patches of each kind that a network learns from, shared evenly by its maps."""
JUDGED = 12
"""Patches of a map that are scored where it is held out."""
MOST_UNKNOWN = 0.9
"""Patches with a larger unknown share are drawn again."""
WIDTH, EPOCHS, BATCH, LEARNING_RATE = 16, 8, 32, 4e-3
"""Settings of the network and its training: half a CPU minute for 50 maps."""
_BLOCK = 2  # 64 cells become 32 x 32 pixels of four times the channels


class PatchLearner:
    """A learner for :func:`slamgym.metrics.two_sample.distinguish`.

    Args:
        maps: Each (H, W), all at one cell size.
        seed: Of the patches.
    """

    def __init__(self, maps: Sequence[ByteArray], seed: int = 0) -> None:
        cut = [cut_patches(cells, np.random.default_rng([seed, i])) for i, cells in enumerate(maps)]
        self.patches: ByteArray = np.stack(cut)
        """(N, PER_MAP, PATCH_SIDE, PATCH_SIDE)."""

    def __call__(self, train: BoolArray, of_second: BoolArray, seed: int) -> FloatArray:
        """Train on some maps and score the others."""
        rng = np.random.default_rng(seed)
        kinds = [self._drawn(np.flatnonzero(train & (of_second == kind)), rng) for kind in (False, True)]
        pictures = _channels(np.concatenate(kinds))
        labels = torch.cat([torch.full((len(kind),), float(k)) for k, kind in enumerate(kinds)])
        network = _trained(pictures, labels, seed)
        held = np.flatnonzero(~train)
        judged = self.patches[held, :JUDGED]
        with torch.inference_mode():
            logits = network(_channels(judged.reshape(-1, *judged.shape[2:])))
        # Means of logits: one sure patch weighs more than an undecided one.
        return torch.sigmoid(logits.reshape(len(held), -1).mean(dim=1)).numpy().astype(np.float64)

    def _drawn(self, maps: IntArray, rng: np.random.Generator) -> ByteArray:
        """Patches of some maps, as many as a kind has, spread evenly over them."""
        shares = np.arange(PER_KIND)
        number = (shares // len(maps) + rng.integers(PER_MAP)) % PER_MAP
        return self.patches[maps[shares % len(maps)], number]


def cut_patches(cells: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Cut patches around random cells of the free space's border; unknown beyond the map.

    Args:
        cells: A map with some free space, (H, W).
        rng: Picks the cells.

    Returns:
        (PER_MAP, PATCH_SIDE, PATCH_SIDE).
    """
    padded = np.pad(cells, PATCH_SIDE, constant_values=UNKNOWN)
    centres = np.argwhere(free_boundary(padded == FREE))
    corners = centres[rng.integers(len(centres), size=4 * PER_MAP)] - PATCH_SIDE // 2
    cut = np.stack([padded[row : row + PATCH_SIDE, col : col + PATCH_SIDE] for row, col in corners])
    dull = (cut == UNKNOWN).mean(axis=(1, 2)) > MOST_UNKNOWN
    # Dull ones stand last: they are taken only where a map has hardly anything else.
    return cut[np.argsort(dull, kind="stable")[:PER_MAP]]


def _channels(patches: ByteArray) -> Tensor:
    """Free, occupied and unknown as channels of 0 and 1, (P, 3, side, side)."""
    classes = np.stack([patches == value for value in (FREE, OCCUPIED, UNKNOWN)], axis=1)
    return torch.from_numpy(classes.astype(np.float32))


def _trained(pictures: Tensor, labels: Tensor, seed: int) -> nn.Module:
    """Train one network; equal seeds give equal networks on one machine.

    Args:
        pictures: (N, 3, S, S).
        labels: 0 or 1, (N,).
        seed: Of the network and of the order.

    Returns:
        The network, which gives logits (N, 1).
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = _network(WIDTH)
        optimiser = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=1e-2)
        steps = EPOCHS * max(1, len(labels) // BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LEARNING_RATE, total_steps=steps)
        for _ in range(steps):
            chosen = torch.randint(len(labels), (BATCH,))
            # The eight flips and quarter turns: a map is no more real for lying on its side.
            seen = torch.rot90(pictures[chosen], int(torch.randint(4, ())), (2, 3))
            seen = seen.flip(3) if torch.rand(()) < 0.5 else seen
            loss = functional.binary_cross_entropy_with_logits(network(seen).squeeze(1), labels[chosen])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    return network.eval()


def _network(width: int) -> nn.Sequential:
    layers: list[nn.Module] = [nn.PixelUnshuffle(_BLOCK)]
    channels = 3 * _BLOCK**2
    for out in (width, 2 * width, 4 * width, 4 * width):
        layers += [nn.Conv2d(channels, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU()]
        layers.append(nn.MaxPool2d(2))
        channels = out
    return nn.Sequential(
        *layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(0.3), nn.Linear(channels, 1)
    )

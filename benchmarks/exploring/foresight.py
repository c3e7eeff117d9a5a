"""The network that completes the map: its data, its training, and pictures of what it foresees.

    python benchmarks/exploring/foresight.py train json.tar.gz [--minutes 60]   # writes the weights of the package
    python benchmarks/exploring/foresight.py draw [--plans json.tar.gz]              # writes out/foresight.png

The weights of the package had 12 minutes, of 96 explorations.
Explorations of HouseExpo plans and of generated homes and offices with loops (split ``train``) give belief maps;
what is unseen floor, and where walls stand, the plans tell.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import torch
import tyro
from exploration_snapshots import Exploration, Snapshot, explorations
from safetensors.numpy import save_file
from torch import Tensor, nn
from torch.nn import functional as fn

from slamgym.agents.foresight import (
    DROPOUT,
    FORESIGHT_CELL,
    LEVEL_CHANNELS,
    WEIGHTS,
    WINDOW_PX,
    pretrained_completion,
    window_about,
)
from slamgym.agents.plan_splits import PlanSplit
from slamgym.cad import open_plans
from slamgym.core.types import OCCUPIED, UNKNOWN, Float32Array, GridFrame

FINE = 0.05
NEAR = 4.0  # what is farther from the known part is not learned [m]
SOURCES = (("{plans}", 160), ("procedural:home:loops", 30), ("procedural:office:loops", 20))


class MapCompletionNetwork(nn.Module):
    """The U-Net of :mod:`slamgym.agents.foresight` in torch."""

    def __init__(self) -> None:
        super().__init__()
        inputs = 2
        self.down, self.up = nn.ModuleList(), nn.ModuleList()
        for width in LEVEL_CHANNELS:
            self.down.append(nn.ModuleList([_conv(inputs, width), _conv(width, width)]))
            inputs = width
        for width in LEVEL_CHANNELS[-2::-1]:
            self.up.append(nn.ModuleList([_conv(inputs + width, width), _conv(width, width)]))
            inputs = width
        self.out = nn.Conv2d(inputs, 2, 1)

    def forward(self, values: Tensor) -> Tensor:
        """Logits of unseen floor and of walls."""
        skips = []
        for level, block in enumerate(self.down):
            first, second = block.children()
            values = fn.max_pool2d(values, 2) if level else values
            if level == len(LEVEL_CHANNELS) - 1:
                values = fn.dropout2d(values, DROPOUT[0], self.training)
            values = fn.relu(second(fn.relu(first(values))))
            skips.append(values)
        for level, block in enumerate(self.up):
            first, second = block.children()
            values = torch.cat([fn.interpolate(values, scale_factor=2.0), skips[-2 - level]], 1)
            values = fn.dropout2d(values, DROPOUT[level + 1], self.training)
            values = fn.relu(second(fn.relu(first(values))))
        logits: Tensor = self.out(values)
        return logits


def train(plans: tyro.conf.Positional[str], minutes: float = 60.0, out: Path = WEIGHTS) -> None:
    """Explore, learn for some minutes of CPU time, and write the weights.

    Args:
        plans: HouseExpo plans.
        minutes: CPU time of the training.
        out: The weights.
    """
    samples = [sample for spec, count in SOURCES for sample in _samples(spec.format(plans=plans), count)]
    rng, network = np.random.default_rng(0), MapCompletionNetwork()
    torch.manual_seed(0)
    optimiser = torch.optim.AdamW(network.parameters(), 2e-3, weight_decay=1e-4)
    average = {name: value.clone() for name, value in network.state_dict().items()}
    began, step = time.process_time(), 0
    while (spent := (time.process_time() - began) / (60.0 * minutes)) < 1.0:
        optimiser.param_groups[0]["lr"] = 2e-3 * min(1.0, step / 200.0) * max(0.02, 1.0 - spent)
        known, target = _batch(samples, rng)
        loss = _loss(network(known), known, target)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        for name, value in network.state_dict().items():
            average[name].mul_(0.995).add_(value, alpha=0.005)
        step += 1
        if step % 100 == 0:
            print(f"step {step}: loss {loss.item():.3f}", flush=True)
    about = {"slamgym": json.dumps({"steps": step, "samples": len(samples), "cpu_minutes": minutes})}
    save_file({name: value.numpy() for name, value in average.items()}, out, about)


def draw(
    plans: str = "bundled",
    split: Annotated[PlanSplit, tyro.conf.arg(help="Whose plans are drawn.")] = "test",
    count: int = 4,
    out: Path = Path("out/foresight.png"),
) -> None:
    """Draw what the network foresees in some explorations: the belief, what it expects, the truth.

    Args:
        plans: Floor plans.
        split: Those drawn.
        count: How many explorations; each at two moments.
        out: The picture.
    """
    rows = []
    for exploration in explorations(open_plans(plans), split, count, "ground_truth"):
        for share in (0.4, 0.75):
            snapshot = next(one for one in exploration.snapshots if one.coverage >= share)
            rows.append(_picture(exploration, snapshot))
    out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(out), np.vstack(rows))
    print(out)


def _conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)


@dataclass(frozen=True)
class _Sample:
    """A window: shares of free and occupied cells as believed; of unseen floor and walls in truth."""

    known: Float32Array
    truth: Float32Array


def _samples(spec: str, count: int) -> list[_Sample]:
    found = []
    for exploration in explorations(open_plans(spec), "train", count, "ground_truth"):
        last = -np.inf
        for snapshot in exploration.snapshots:
            if snapshot.time - last >= 4.0 or snapshot.coverage >= 0.97:
                last = snapshot.time
                known, frame = window_about(snapshot.known, snapshot.pose)
                found.append(_Sample(known, _truth(exploration, snapshot, frame)))
    return found


def _truth(exploration: Exploration, snapshot: Snapshot, frame: GridFrame) -> Float32Array:
    """Unseen floor and walls in a window of the map frame, shape (2, n, n)."""
    start, ratio = exploration.start, round(FORESIGHT_CELL / FINE)
    fine = GridFrame(FINE, frame.origin_x, frame.origin_y, WINDOW_PX * ratio, WINDOW_PX * ratio)
    x, y = fine.to_point(*np.indices(fine.shape))
    floor_frame = exploration.floor_frame
    row, col = floor_frame.to_cell(x + start.x, y + start.y)
    inside = (row >= 0) & (col >= 0) & (row < floor_frame.height_px) & (col < floor_frame.width_px)
    unseen = np.zeros(fine.shape, np.float32)
    unseen[inside] = (exploration.floor & ~snapshot.seen)[row[inside], col[inside]]
    walls = (
        exploration.plan.raster(FINE, frame=fine, offset=(start.x, start.y), outside=UNKNOWN).cells
        == OCCUPIED
    )
    shares = np.stack([unseen, walls]).reshape(2, WINDOW_PX, ratio, WINDOW_PX, ratio).mean(axis=(2, 4))
    shares[1] = np.minimum(1.0, 3.0 * shares[1])
    return shares.astype(np.float32)


def _batch(samples: list[_Sample], rng: np.random.Generator, size: int = 32) -> tuple[Tensor, Tensor]:
    """Windows turned and flipped at random."""
    pairs = []
    for index in rng.integers(len(samples), size=size):
        both = np.concatenate([samples[index].known, samples[index].truth])
        both = np.rot90(both, int(rng.integers(4)), axes=(1, 2))
        pairs.append(both[:, :, ::-1] if rng.random() < 0.5 else both)
    stacked = torch.from_numpy(np.stack(pairs).astype(np.float32))
    return stacked[:, :2], stacked[:, 2:]


def _loss(logits: Tensor, known: Tensor, target: Tensor) -> Tensor:
    """Cross-entropy near what is known; walls count half."""
    is_known = (known.sum(1, keepdim=True) > 0).float()
    reach = round(NEAR / FORESIGHT_CELL / 4)
    near = fn.max_pool2d(fn.max_pool2d(is_known, 4), 2 * reach + 1, 1, reach)
    near = fn.interpolate(near, scale_factor=4.0)[:, 0]
    losses = fn.binary_cross_entropy_with_logits(logits, target, reduction="none")
    return ((losses[:, 0] + 0.5 * losses[:, 1]) * near).sum() / near.sum()


def _picture(exploration: Exploration, snapshot: Snapshot) -> Any:
    """Belief, expectation, doubt and truth side by side: floor green, walls dark."""
    foreseen = pretrained_completion().complete(snapshot.known, snapshot.pose)
    known, frame = window_about(snapshot.known, snapshot.pose)
    truth = _truth(exploration, snapshot, frame)
    floor, wall = foreseen.floor.mean(axis=0), foreseen.wall.mean(axis=0)
    doubt = foreseen.floor.std(axis=0)
    panels = [
        _panel(known, np.zeros_like(floor), np.zeros_like(floor)),
        _panel(known, floor, wall),
        _panel(known, np.minimum(1.0, 4.0 * doubt), np.zeros_like(floor)),
        _panel(known, truth[0], truth[1]),
    ]
    return np.hstack(panels)


def _panel(known: Float32Array, floor: Float32Array, wall: Float32Array) -> Any:
    """One picture, BGR: the belief in grey, floor beyond it in green, walls beyond it in red."""
    grey = 205.0 + 50.0 * known[0] - 205.0 * np.minimum(1.0, 2.0 * known[1])
    picture = np.repeat(grey[:, :, None], 3, axis=2)
    unknown = 1.0 - np.minimum(1.0, known.sum(axis=0))
    for share, colour in ((floor, (90.0, 200.0, 90.0)), (wall * unknown, (40.0, 40.0, 220.0))):
        picture += share[:, :, None] * (np.array(colour) - picture)
    enlarged = cv2.resize(
        np.clip(picture, 0, 255).astype(np.uint8), None, fx=4, fy=4, interpolation=cv2.INTER_NEAREST
    )
    return cv2.copyMakeBorder(enlarged, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"train": train, "draw": draw})

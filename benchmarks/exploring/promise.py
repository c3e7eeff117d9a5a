"""When an exploration may stop: calibrates the limits of the estimate of unseen floor and tests the promises.

    python benchmarks/exploring/promise.py json.tar.gz [--train 95] [--write]  # tables; --write stores the estimate

With ``--train`` the estimate is first fitted again on plans of the split ``train``. The limits are calibrated on
``validation`` and tested on ``test``, all with the particle filter, in empty and in furnished homes. Stopping earlier
changes nothing of what came before, so every promise is tested on the same explorations. Some 2 s of CPU an
exploration, 6 s where there is furniture.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from exploration_snapshots import Exploration, explorations
from safetensors.numpy import load_file, save_file
from torch import Tensor, nn
from torch.nn import functional as fn

from slamgym.agents.plan_splits import PlanSplit
from slamgym.cad import open_plans
from slamgym.core.intervals import wilson_interval
from slamgym.core.types import Float32Array
from slamgym.planning.promise import PRETRAINED_ESTIMATE, Promise, UnseenFloor
from slamgym.planning.remaining import FRONTIER_FEATURES, WHOLE_FEATURES

sys.path.insert(0, str(Path(__file__).parents[1]))
from report import print_and_save

SHARES = np.log([0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2])
PROMISES = (
    "95%:90%",
    "98%:50%",
    "98%:70%",
    "98%:80%",
    "98%:90%",
    "98%:95%",
    "99%:95%",
    "99.5%:90%",
    "1m2:80%",
    "5m2:95%",
)
MOST = 24
EPOCHS = 30


@dataclass(frozen=True)
class Arguments:
    """Settings of the explorations."""

    plans: tyro.conf.Positional[str]
    """HouseExpo plans."""
    train: int = 0
    """HouseExpo plans to fit on, and a third as many generated homes and offices each; 0 for the shipped weights."""
    calibrate: tuple[int, int] = (250, 200)
    """HouseExpo plans to calibrate on, empty and furnished."""
    test: tuple[int, int] = (45, 60)
    """HouseExpo plans to test on, empty, and a third as many generated homes; and furnished."""
    write: bool = False
    """Store the estimate as the one of the package."""


class EstimateNetwork(nn.Module):
    """The sums of :class:`~slamgym.planning.promise.UnseenFloor` in torch."""

    def __init__(self, width: int = 16) -> None:
        super().__init__()
        inputs = len(FRONTIER_FEATURES) + len(WHOLE_FEATURES)
        self.a, self.b, self.c = nn.Linear(inputs, width), nn.Linear(width, width), nn.Linear(width, 1)
        self.g, self.o = nn.Linear(len(WHOLE_FEATURES), 8), nn.Linear(8, 1)
        self.slope = nn.Parameter(torch.tensor(1.0))

    def forward(self, frontiers: Tensor, whole: Tensor, known_area: Tensor) -> Tensor:
        """Logarithm of the unseen share, shape (B,), of frontiers (B, MOST, F) whose absent rows are nan."""
        there = ~frontiers[..., 0].isnan()
        inputs = torch.cat([frontiers.nan_to_num(), whole[:, None].expand(-1, MOST, -1)], 2)
        hidden = fn.relu(self.b(fn.relu(self.a(inputs))))
        behind = torch.exp(self.c(hidden)[..., 0].clamp(-8.0, 5.0)) * there
        unseen = behind.sum(1) + torch.exp(self.o(fn.relu(self.g(whole)))[:, 0].clamp(-8.0, 5.0))
        return torch.log(unseen / (unseen + known_area))


def main() -> None:
    arguments = tyro.cli(Arguments)
    weights = _weights(arguments.plans, arguments.train)
    calibrated = _explored(arguments.plans, "validation", arguments.calibrate[0])
    calibrated += _explored(arguments.plans, "validation", arguments.calibrate[1], is_furnished=True)
    arrays = _calibration(weights, calibrated)
    empty = _explored(arguments.plans, "test", arguments.test[0])
    empty += _explored("procedural:home:loops", "test", arguments.test[0] // 3)
    furnished = _explored(arguments.plans, "test", arguments.test[1], is_furnished=True)
    for name, tested in (("promise", empty), ("promise_furnished", furnished)):
        rows = [_tested(Promise.parse(text), UnseenFloor(arrays), tested) for text in PROMISES]
        title = f"calibrated on {len(calibrated)}, tested on {len(tested)} explorations"
        print_and_save(f"exploring/{name}", title, rows, list(rows[0]))
    if arguments.write:
        about = {"calibrated on": len(calibrated)}
        save_file(arrays, PRETRAINED_ESTIMATE, {"slamgym": json.dumps(about)})


def fit(explored: Sequence[Exploration]) -> dict[str, Float32Array]:
    """Fit the estimate: the true share is above each of some shares with log-logistic probability."""
    torch.manual_seed(0)
    moments = [
        (moment, moment.remains) for one in explored for moment in one.snapshots if moment.remains is not None
    ]
    frontiers = np.full((len(moments), MOST, len(FRONTIER_FEATURES)), np.nan, np.float32)
    for row, (_, remains) in zip(frontiers, moments, strict=True):
        row[: len(remains.frontiers)] = remains.frontiers
    inputs = [
        torch.from_numpy(frontiers),
        torch.tensor(np.array([remains.whole for _, remains in moments]), dtype=torch.float32),
        torch.tensor([remains.known_area for _, remains in moments]),
    ]
    share = torch.tensor([1.0 - moment.coverage for moment, _ in moments])
    above = (share[:, None] > torch.exp(torch.tensor(SHARES))[None]).float()
    weight = torch.where(share < 0.15, 2.0, 1.0)
    network = EstimateNetwork()
    optimiser = torch.optim.AdamW(network.parameters(), 3e-3, weight_decay=1e-3)
    steps = EPOCHS * (len(share) // 256 + 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 1e-2, total_steps=steps)
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(share)).split(256):
            logits = network.slope * (network(*(one[rows] for one in inputs))[:, None] - torch.tensor(SHARES))
            losses = fn.binary_cross_entropy_with_logits(logits.float(), above[rows], reduction="none").mean(
                1
            )
            optimiser.zero_grad()
            (losses * weight[rows]).mean().backward()
            optimiser.step()
            schedule.step()
    return {name: value.numpy() for name, value in network.state_dict().items() if name != "slope"}


def _weights(plans: str, count: int) -> dict[str, Float32Array]:
    """Weights fitted again on so many plans; the package's for none."""
    if not count:
        arrays: dict[str, Float32Array] = load_file(PRETRAINED_ESTIMATE)
        return {name: values for name, values in arrays.items() if not name.startswith("calibration.")}
    return fit(
        [
            *_explored(plans, "train", count),
            *_explored("procedural:home:loops", "train", count // 3),
            *_explored("procedural:office:loops", "train", count // 3),
        ]
    )


def _explored(plans: str, split: PlanSplit, count: int, is_furnished: bool = False) -> list[Exploration]:
    return list(explorations(open_plans(plans), split, count, "rbpf", is_furnished))


def _calibration(
    weights: dict[str, Float32Array], explored: Sequence[Exploration]
) -> dict[str, Float32Array]:
    """The weights with the moments that decide about limits: each new lowest estimate, and the end."""
    unseen, rows = UnseenFloor(weights), []
    for index, one in enumerate(explored):
        lowest = np.inf
        for moment in one.snapshots:
            estimate = unseen.share(moment.remains) if moment.remains is not None else np.inf
            if estimate < lowest:
                lowest, left = estimate, 1.0 - moment.coverage
                rows.append((index, estimate, left, left * one.area))
        left = 1.0 - one.curve[-1, 1]
        rows.append((index, lowest, left, left * one.area))
    columns = np.ascontiguousarray(np.array(rows, np.float32).T)  # safetensors writes buffers as they lie
    names = ("exploration", "estimate", "share", "area")
    return weights | {f"calibration.{name}": column for name, column in zip(names, columns, strict=True)}


def _tested(promise: Promise, unseen: UnseenFloor, explored: Sequence[Exploration]) -> dict[str, object]:
    """Figures on how well a promise is kept."""
    limit, kept, times, tails, ends = unseen.limit(promise), [], [], [], []
    for one in explored:
        time, coverage = one.curve[-1]
        ends.append(time)
        for moment in one.snapshots:
            if moment.remains is not None and unseen.share(moment.remains) < limit:
                time, coverage = moment.time, moment.coverage
                break
        is_kept = promise.holds(coverage, one.area)
        kept.append(is_kept)
        times.append(time)
        reached = np.flatnonzero(one.curve[:, 1] >= 0.99)
        if is_kept:
            tails.append(max(0.0, time - one.curve[reached[0], 0]) if len(reached) else 0.0)
    interval = wilson_interval(sum(kept), len(kept))
    return {
        "promise": str(promise),
        "kept [%]": round(100.0 * float(np.mean(kept)), 1),
        "95 %": f"{100.0 * interval.low:.0f}-{100.0 * interval.high:.0f}",
        "time [s]": round(float(np.mean(times))),
        "without it [s]": round(float(np.mean(ends))),
        "tail after 99 % [s]": round(float(np.mean(tails)), 1) if tails else None,
    }


if __name__ == "__main__":
    main()

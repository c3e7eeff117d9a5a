"""Training of the texture network: maximum likelihood on tiles, resumable, as long as one likes."""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from slamgym.core.config import Count, Positive, Settings, Within, to_dict
from slamgym.core.errors import InputFileError
from slamgym.core.files import staged
from slamgym.core.progress import say
from slamgym.core.types import UNKNOWN, ByteArray, Float32Array
from slamgym.gan.texture.generator import save_texture
from slamgym.gan.texture.network import CLASSES, TextureConfig, TextureNetwork, pass_numbers


class TextureTrainingConfig(Settings):
    """How the network is trained."""

    network: TextureConfig = TextureConfig()
    tile: Annotated[int, Within(ge=32)] = 128
    """Side of the tiles [cells]."""
    batch: Count = 8
    """Tiles a step."""
    learning_rate: Positive = 2e-3
    average: Annotated[float, Within(ge=0.0, lt=1.0)] = 0.995
    """Of the exponential average of the weights, which is what is saved."""
    seed: int = 0


@dataclass(frozen=True)
class TextureExample:
    """A simulated map and what error-free scans counted along the same believed path."""

    counted: Float32Array  # (3, H, W)
    style: Float32Array  # (styles,)
    cells: ByteArray  # (H, W)


def train_texture(
    examples: Sequence[TextureExample],
    run: Path,
    config: TextureTrainingConfig,
    minutes: float,
    checkpoint_minutes: float = 2.0,
) -> float:
    """Train, going on from the run's checkpoint if there is one.

    Args:
        examples: What to learn from; each is seen as often as the others.
        run: Folder of checkpoint and weights.
        config: The settings.
        minutes: CPU time of this call [min].
        checkpoint_minutes: Between checkpoints [min].

    Returns:
        Mean loss of the last hundred steps [nat a cell].

    Raises:
        InputFileError: If the run's files can't be read or written, or belong to other settings.
    """
    torch.manual_seed(config.seed)
    network = TextureNetwork(config.network)

    def towards(mean: Tensor, new: Tensor, updates: Tensor | int) -> Tensor:
        # At the beginning the mean follows faster, so that it forgets the random weights.
        keep = min(config.average, (1.0 + float(updates)) / (10.0 + float(updates)))
        return mean + (1.0 - keep) * (new - mean)

    average = AveragedModel(network, avg_fn=towards)
    optimiser = torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=1e-3)
    checkpoint = run / "checkpoint.pt"
    steps = _restore(checkpoint, config, network, average, optimiser) if checkpoint.is_file() else 0
    losses: list[float] = []
    begun = saved = time.process_time()
    while time.process_time() - begun < 60.0 * minutes:
        rng = np.random.default_rng([config.seed, steps])
        loss = _step(network, _batch(examples, config, rng), optimiser)
        average.update_parameters(network)
        steps += 1
        losses = [*losses[-99:], loss]
        if time.process_time() - saved > 60.0 * checkpoint_minutes:
            saved = time.process_time()
            _save(run, steps, config, network, average, optimiser, float(np.mean(losses)))
    _save(run, steps, config, network, average, optimiser, float(np.mean(losses)))
    return float(np.mean(losses))


def _batch(
    examples: Sequence[TextureExample], config: TextureTrainingConfig, rng: np.random.Generator
) -> tuple[torch.Tensor, ...]:
    """Tiles in any of the eight positions: counted, style, classes, passes."""
    counted, styles, classes = [], [], []
    side = config.tile
    for number in rng.integers(len(examples), size=config.batch):
        example = examples[number]
        around = ((side, side), (side, side))
        cells = np.pad(example.cells, around, constant_values=UNKNOWN)
        both = np.concatenate([np.pad(example.counted, ((0, 0), *around)), cells[None].astype(np.float32)])
        centres = np.argwhere(example.counted[1] > 0.0)
        row, col = (
            centres[rng.integers(len(centres))] + side + rng.integers(-side // 3, side // 3, 2) - side // 2
        )
        tile = np.rot90(both[:, row : row + side, col : col + side], int(rng.integers(4)), (1, 2))
        tile = tile[:, :, ::-1] if rng.random() < 0.5 else tile
        counted.append(tile[:3])
        classes.append(np.select([tile[3] == CLASSES[0], tile[3] == CLASSES[1]], [0, 1], 2))
        styles.append(example.style)
    passes = pass_numbers(side, side, (int(rng.integers(4)), int(rng.integers(4))))
    return (
        torch.from_numpy(np.ascontiguousarray(np.stack(counted))),
        torch.from_numpy(np.stack(styles)),
        torch.from_numpy(np.stack(classes).astype(np.int64)),
        torch.from_numpy(passes),
    )


def _step(
    network: TextureNetwork, batch: tuple[torch.Tensor, ...], optimiser: torch.optim.Optimizer
) -> float:
    counted, style, classes, passes = batch
    with torch.autocast("cpu", torch.bfloat16):
        loss = network.loss(counted.to(memory_format=torch.channels_last), style, classes, passes)
    optimiser.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimiser.step()
    return float(loss.detach())


def _save(
    run: Path,
    steps: int,
    config: TextureTrainingConfig,
    network: TextureNetwork,
    average: AveragedModel,
    optimiser: torch.optim.Optimizer,
    loss: float,
) -> None:
    run.mkdir(parents=True, exist_ok=True)
    state = {
        "steps": steps,
        "config": json.dumps(to_dict(config)),
        "network": network.state_dict(),
        "average": average.state_dict(),
        "optimiser": optimiser.state_dict(),
    }
    with staged(run / "checkpoint.pt") as part:
        torch.save(state, part)
    drawn = TextureNetwork(config.network)
    drawn.load_state_dict(average.module.state_dict())
    save_texture(run / "weights.safetensors", drawn, {"steps": steps, "loss": loss})
    say(f"{steps:,} steps, loss {loss:.4f} nat a cell")


def _restore(
    path: Path,
    config: TextureTrainingConfig,
    network: TextureNetwork,
    average: AveragedModel,
    optimiser: torch.optim.Optimizer,
) -> int:
    try:
        state = torch.load(path, weights_only=True)
        if state["config"] != json.dumps(to_dict(config)):
            raise InputFileError(
                path, "belongs to a training with other settings; train in another folder (-o)"
            )
        network.load_state_dict(state["network"])
        average.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
    except (RuntimeError, KeyError, ValueError, OSError) as error:
        raise InputFileError(path, "is damaged; train in another folder (-o)") from error
    return int(state["steps"])

"""A small convolutional network as the learner of the two-sample test: it sees pictures instead of statistics.

Trees on map statistics are the stricter test of small samples; the network needs no statistics to be thought of. It
sees the SLAM map and the CAD map that it was made from, so that a realistic map of another building is detected.
"""

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from slamgym.core.config import Settings
from slamgym.core.errors import ConfigError
from slamgym.core.intervals import Interval, mean_interval
from slamgym.core.types import FREE, OCCUPIED, ByteArray, FloatArray
from slamgym.gan.evaluation.generated_maps import Sample


class ClassifierConfig(Settings):
    """How the network is trained in each fold."""

    size: int = 64
    """Maps are shrunk to this side by area [px]."""
    width: int = 16
    epochs: int = 20
    batch: int = 32
    learning_rate: float = 2e-3
    folds: int = 5


DEFAULT_CLASSIFIER = ClassifierConfig()


def picture_test(
    simulated: Sample, generated: Sample, seed: int = 0, config: ClassifierConfig = DEFAULT_CLASSIFIER
) -> Interval:
    """Cross-validated accuracy of distinguishing generated from simulated maps by their pictures.

    Args:
        simulated: SLAM maps with their CAD maps; maps of one plan stay in one fold.
        generated: The maps to distinguish from them.
        seed: Of the folds and the networks.
        config: How the networks are trained.

    Returns:
        The accuracy, 0.5 is perfect, with a 95 % bootstrap interval over plans.

    Raises:
        ConfigError: If there are fewer plans than folds.
    """
    pictures = torch.cat([_channels(sample.maps, sample.cad, config) for sample in (simulated, generated)])
    labels = torch.cat([torch.zeros(len(simulated.maps)), torch.ones(len(generated.maps))])
    plans = [*simulated.plans, *generated.plans]
    group = np.unique(np.array(plans), return_inverse=True)[1]
    if group.max() + 1 < config.folds:
        raise ConfigError(f"a test with {config.folds} folds needs as many plans, not {group.max() + 1}")
    fold = (np.random.default_rng(seed).permutation(group.max() + 1) % config.folds)[group]
    right: FloatArray = np.zeros(len(labels))
    for k in range(config.folds):
        held_out = torch.from_numpy(fold == k)
        network = train_classifier(pictures[~held_out], labels[~held_out], seed + k, config)
        with torch.inference_mode():
            guess = network(pictures[held_out]).squeeze(1) > 0.0
        right[fold == k] = (guess == (labels[held_out] > 0.5)).numpy()
    return mean_interval(right, groups=plans)


def _channels(maps: ByteArray, cads: ByteArray, config: ClassifierConfig) -> Tensor:
    """Shares of free, of occupied and of the CAD map's floor, (N, 3, size, size) in [-1, 1]."""
    shares = [[(a == FREE), (a == OCCUPIED), (b > 127)] for a, b in zip(maps, cads, strict=True)]
    side = (config.size, config.size)
    small = [
        [cv2.resize(share.astype(np.float32), side, interpolation=cv2.INTER_AREA) for share in row]
        for row in shares
    ]
    return torch.from_numpy(2.0 * np.array(small, dtype=np.float32) - 1.0)


def train_classifier(
    pictures: Tensor, labels: Tensor, seed: int, config: ClassifierConfig, block: int = 1
) -> nn.Module:
    """Train one network; equal seeds give equal networks on one machine.

    Args:
        pictures: (N, 3, S, S).
        labels: 0 or 1, (N,).
        seed: Of the network and of the order.
        config: How it is trained.
        block: Blocks of so many pixels become channels first, which loses nothing and saves time.

    Returns:
        The network, which gives logits (N, 1).
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = _network(config.width, block)
        optimiser = torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=1e-2)
        steps = config.epochs * max(1, len(labels) // config.batch)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.learning_rate, total_steps=steps)
        for _ in range(steps):
            chosen = torch.randint(len(labels), (config.batch,))
            # The eight flips and quarter turns: a map is no more real for lying on its side.
            seen = torch.rot90(pictures[chosen], int(torch.randint(4, ())), (2, 3))
            seen = seen.flip(3) if torch.rand(()) < 0.5 else seen
            loss = functional.binary_cross_entropy_with_logits(network(seen).squeeze(1), labels[chosen])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
    return network.eval()


def _network(width: int, block: int) -> nn.Sequential:
    layers: list[nn.Module] = [nn.PixelUnshuffle(block)] if block > 1 else []
    channels = 3 * block**2
    for out in (width, 2 * width, 4 * width, 4 * width):
        layers += [nn.Conv2d(channels, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU()]
        layers.append(nn.MaxPool2d(2))
        channels = out
    return nn.Sequential(
        *layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(0.3), nn.Linear(channels, 1)
    )

"""One step of training: the generator and its discriminators, their losses and optimisers.

The discriminators' features of real pairs are computed once for both steps, and the discriminators' weights are frozen
while the generator's gradient passes through them, which saves a tenth of the published code's work.
"""

import copy
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Adam, Optimizer

from slamgym.core.types import ByteArray
from slamgym.gan.config import Encoding, TranslatorTrainingConfig
from slamgym.gan.data import PairSet
from slamgym.gan.device import Compute
from slamgym.gan.encoding import encode
from slamgym.gan.networks.factory import Generator, build_discriminators, build_generator
from slamgym.gan.networks.layers import GeneratorOutput, shrink_to
from slamgym.gan.training import losses
from slamgym.gan.training.sampler import Batch, BatchSampler
from slamgym.gan.training.schedule import Moment, Schedule, Span
from slamgym.metrics.maps import resample_slam

WARM_UP_STEPS, MEASURED_STEPS = 1, 2
"""Of the measurement of what a step costs."""


class Learner:
    """The networks in training."""

    def __init__(self, config: TranslatorTrainingConfig, compute: Compute) -> None:
        """Build networks and optimisers; equal seeds give equal weights."""
        self.config = config
        self.compute = compute
        translator = config.translator
        self.generator: Generator = compute.put(build_generator(translator, config.seed))
        self.discriminators = compute.put(
            build_discriminators(translator, config.discriminator, config.loss, config.seed)
        )
        self.average = copy.deepcopy(self.generator) if config.optimiser.average > 0.0 else None
        self.optimisers = {"generator": self._optimiser(self.generator)}
        self.optimisers |= {name: self._optimiser(network) for name, network in self.discriminators.items()}
        self.steps_done = 0

    @property
    def best_generator(self) -> Generator:
        """The one to use: the moving average where one is kept."""
        return self.average or self.generator

    def networks(self) -> dict[str, nn.Module]:
        """All that has weights, by name."""
        named: dict[str, nn.Module] = {"generator": self.generator}
        named |= {f"discriminator_{name}": network for name, network in self.discriminators.items()}
        if self.average is not None:
            named["average"] = self.average
        return named

    def adopt(self, generator: Generator) -> None:
        """Start with the weights of a trained generator of the same settings; the discriminators start again."""
        for network in (self.generator, self.average):
            if network is not None:
                network.load_state_dict(generator.state_dict())

    def compile(self, backend: str = "inductor") -> None:
        """Let torch compile the networks in training; names and state stay as they are.

        Args:
            backend: Of torch.compile.
        """
        for network in (self.generator, *self.discriminators.values()):
            network.compile(backend=backend)

    def step(self, batch: Batch, moment: Moment) -> dict[str, float]:
        """Move all networks once.

        Args:
            batch: Pairs, changed.
            moment: Resolution, fade-in and learning rate.

        Returns:
            The terms of the losses, before weighting, and their ``total``. If that isn't finite nothing was moved.
        """
        self.generator.train()
        self.discriminators.train()
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = self.config.optimiser.learning_rate * moment.rate
        x, y, other = self._encoded(batch, moment.resolution)
        x_small = shrink_to(x, moment.resolution)
        with self.compute.autocast():
            real = self._features(x_small, y, moment.fade)
            with _frozen(self.discriminators):
                output = self.generator(x, moment.resolution, moment.fade)
                terms = self._generator_terms(output, x_small, y, real, moment.fade)
        total = self._weighted(terms)
        values = {name: term.detach() for name, term in terms.items()} | {"total": total.detach()}
        if not bool(torch.isfinite(total)):
            # The weights stay as they are; besides, some backward kernels crash on NaN.
            return {name: float(value) for name, value in values.items()}
        self._descend("generator", total)
        image = output.image.detach()
        for name, term in self._discriminator_terms(image, x_small, other, real, moment.fade).items():
            self._descend(name, term)
            values[f"discriminator_{name}"] = term.detach()
        self._update_average()
        self.steps_done += 1
        # One transfer for all terms.
        numbers = torch.stack([value.float() for value in values.values()]).tolist()
        return dict(zip(values, numbers, strict=True))

    def _encoded(self, batch: Batch, resolution: int) -> tuple[Tensor, Tensor, Tensor | None]:
        """Input (B, in, S, S), target and unassociated target (B, out, R, R), if a discriminator sees such."""
        to_cad = self.config.translator.direction == "slam2cad"
        x, y = (batch.slam, batch.cad) if to_cad else (batch.cad, batch.slam)
        other = batch.other_cad if to_cad else batch.other_slam
        seen = self._on_device(x, self.config.translator.input_encoding)
        unassociated = None
        if self.config.needs_unassociated and other is not None:
            unassociated = self._target(other, resolution)
        return seen, self._target(y, resolution), unassociated

    def _target(self, cells: ByteArray, resolution: int) -> Tensor:
        if self.config.translator.direction == "cad2slam":
            # Cells have one of three values at any resolution. The mean of a thin wall would be a pale grey, and a
            # generator that learns such a grey gives no wall at all once its values are classified.
            cells = np.stack([resample_slam(image, (resolution, resolution)) for image in cells])
        return shrink_to(self._on_device(cells, self.config.translator.output_encoding), resolution)

    def _on_device(self, cells: ByteArray, encoding: Encoding) -> Tensor:
        images = encode(torch.from_numpy(cells).to(self.compute.device), encoding)
        return images.contiguous(memory_format=self.compute.memory_format)

    def _features(self, x_small: Tensor, y: Tensor, fade: float) -> losses.FeaturesByName:
        """Of pairs, by each discriminator."""
        features: losses.FeaturesByName = {}
        if "domain" in self.discriminators:
            features["domain"] = self.discriminators["domain"](x_small, y, fade)
        if "real_fake" in self.discriminators:
            features["real_fake"] = self.discriminators["real_fake"](y, fade)
        return features

    def _generator_terms(
        self, output: GeneratorOutput, x_small: Tensor, y: Tensor, real: losses.FeaturesByName, fade: float
    ) -> dict[str, Tensor]:
        loss = self.config.loss
        fake = self._features(x_small, output.image, fade)
        terms: dict[str, Tensor] = {}
        if "domain" in fake and loss.domain > 0.0:
            terms["domain"] = losses.taken_for_real_loss(fake["domain"])
        if "domain" in fake and loss.feature_matching > 0.0:
            terms["feature_matching"] = losses.feature_matching_loss(
                fake["domain"], real["domain"], loss.layer_weights
            )
        if "real_fake" in fake and loss.real_fake > 0.0:
            terms["real_fake"] = losses.taken_for_real_loss(fake["real_fake"])
        if "real_fake" in fake and loss.input_consistency > 0.0:
            terms["input_consistency"] = losses.feature_matching_loss(
                fake["real_fake"], real["real_fake"], loss.layer_weights
            )
        if loss.l1 > 0.0:
            terms["l1"] = losses.l1_loss(output.image, y)
        if loss.cross_entropy > 0.0:
            terms["cross_entropy"] = losses.cross_entropy_loss(
                output.image, output.logits, y, loss.edge_weight, loss.wall_weight
            )
        if loss.dice > 0.0:
            terms["dice"] = losses.dice_loss(output.image, y)
        return terms

    def _weighted(self, terms: dict[str, Tensor]) -> Tensor:
        """Eq. (1): the sum of all terms, each with its weight."""
        weights = self.config.loss
        return torch.stack([getattr(weights, name) * term for name, term in terms.items()]).sum()

    def _discriminator_terms(
        self, image: Tensor, x_small: Tensor, other: Tensor | None, real: losses.FeaturesByName, fade: float
    ) -> dict[str, Tensor]:
        """Losses of the discriminators, of eqs. (2) and (3)."""
        terms: dict[str, Tensor] = {}
        with self.compute.autocast():
            fake = self._features(x_small, image, fade)
            if "domain" in fake:
                unassociated = None if other is None else self.discriminators["domain"](x_small, other, fade)
                terms["domain"] = losses.domain_discriminator_loss(
                    real["domain"], fake["domain"], unassociated
                )
            if "real_fake" in fake:
                terms["real_fake"] = losses.real_fake_discriminator_loss(real["real_fake"], fake["real_fake"])
        return terms

    def _descend(self, name: str, loss: Tensor) -> None:
        optimiser = self.optimisers[name]
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        if name == "generator" and self.config.optimiser.clip_norm > 0.0:
            nn.utils.clip_grad_norm_(self.generator.parameters(), self.config.optimiser.clip_norm)
        optimiser.step()

    def _update_average(self) -> None:
        if self.average is None:
            return
        # Early on the average must not hang on to the first, random weights.
        keep = min(self.config.optimiser.average, (1.0 + self.steps_done) / (10.0 + self.steps_done))
        with torch.no_grad():
            for mean, now in zip(self.average.parameters(), self.generator.parameters(), strict=True):
                mean.lerp_(now, 1.0 - keep)
            buffers = zip(self.average.buffers(), self.generator.buffers(), strict=True)
            for mean_buffer, buffer in buffers:
                mean_buffer.copy_(buffer)

    def _optimiser(self, network: nn.Module) -> Optimizer:
        settings = self.config.optimiser
        betas = (settings.beta1, settings.beta2)
        return Adam(network.parameters(), settings.learning_rate, betas)


@contextmanager
def _frozen(networks: nn.Module) -> Iterator[None]:
    """Take weights as constants inside the block; gradients still pass through to what they are applied to."""
    networks.requires_grad_(False)
    try:
        yield
    finally:
        networks.requires_grad_(True)


def measure_seconds(
    schedule: Schedule, pairs: PairSet, config: TranslatorTrainingConfig, compute: Compute
) -> list[float]:
    """Wall-clock seconds of one step in each span, measured on networks of their own.

    The networks in training, their optimisers and the order of the data are not touched.
    """
    learner = Learner(config, compute)
    sampler = BatchSampler(pairs, config, np.random.default_rng(0))
    measured: dict[tuple[int, int], float] = {}
    for span in schedule.spans:
        key = (span.resolution, span.batch)
        if key not in measured:
            measured[key] = _seconds(learner, sampler, span)
    return [measured[span.resolution, span.batch] for span in schedule.spans]


def _seconds(learner: Learner, sampler: BatchSampler, span: Span) -> float:
    moment = Moment(span.resolution, span.batch, 1.0, 0.0)
    times = []
    for _ in range(WARM_UP_STEPS + MEASURED_STEPS):
        began = time.monotonic()
        learner.step(sampler.draw(span.batch), moment)
        learner.compute.synchronise()
        times.append(time.monotonic() - began)
    return min(times[WARM_UP_STEPS:])

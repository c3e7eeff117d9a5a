"""One step of training: the generator and its judges, their losses and optimisers.

The judges' features of real pairs are computed once for both steps, and the judges' weights are frozen while the
generator's gradient passes through them, which saves a tenth of the published code's work.
"""

import copy
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim import Adam, AdamW, Optimizer

from slamgym.core.errors import ConfigError
from slamgym.core.types import ByteArray
from slamgym.gan.config import TrainConfig
from slamgym.gan.device import Compute
from slamgym.gan.encoding import encode, resample_slam
from slamgym.gan.networks.discriminators import detached
from slamgym.gan.networks.displacement import roughness
from slamgym.gan.networks.factory import Generator, build_discriminators, build_generator
from slamgym.gan.networks.layers import GeneratorOutput, shrink_to
from slamgym.gan.training import losses
from slamgym.gan.training.sampler import Batch
from slamgym.gan.training.schedule import Moment


class Learner:
    """The networks in training."""

    def __init__(self, config: TrainConfig, compute: Compute) -> None:
        """Build networks and optimisers; equal seeds give equal weights.

        Raises:
            ConfigError: If the settings don't go together.
        """
        self.config = config
        self.compute = compute
        translator = config.translator
        consistency = config.loss.input_consistency_reference
        if consistency == "x" and translator.input_encoding != translator.output_encoding:
            raise ConfigError(
                "loss.input_consistency_reference 'x' needs equal encodings of input and output; use 'y'"
            )
        self.generator: Generator = compute.put(build_generator(translator, config.seed))
        self.judges = compute.put(
            build_discriminators(translator, config.discriminator, config.loss, config.seed)
        )
        self.average = copy.deepcopy(self.generator) if config.optimiser.average > 0.0 else None
        self.optimisers = {"generator": self._optimiser(self.generator)}
        self.optimisers |= {name: self._optimiser(judge) for name, judge in self.judges.items()}
        self.steps_done = 0

    @property
    def best_generator(self) -> Generator:
        """The one to use: the moving average where one is kept."""
        return self.average if self.average is not None else self.generator

    def networks(self) -> dict[str, nn.Module]:
        """All that has weights, by name."""
        named: dict[str, nn.Module] = {"generator": self.generator}
        named |= {f"judge_{name}": judge for name, judge in self.judges.items()}
        if self.average is not None:
            named["average"] = self.average
        return named

    def adopt(self, generator: Generator) -> None:
        """Start with the weights of a trained generator of the same settings; the judges start anew."""
        for network in (self.generator, self.average):
            if network is not None:
                network.load_state_dict(generator.state_dict())

    def compile(self, backend: str = "inductor") -> None:
        """Let torch compile the networks in training; names and state stay as they are.

        Args:
            backend: Of torch.compile.
        """
        for network in (self.generator, *self.judges.values()):
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
        self.judges.train()
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = self.config.optimiser.learning_rate * moment.rate
        x, y, other = self._encoded(batch, moment.resolution)
        x_small = shrink_to(x, moment.resolution)
        with self.compute.autocast():
            real = self._judge(x_small, y, moment.fade)
            with _frozen(self.judges):
                drawing = self.generator(x, moment.resolution, moment.fade)
                terms = self._generator_terms(drawing, x_small, y, real, moment.fade)
        total = self._weighted(terms)
        told = {name: term.detach() for name, term in terms.items()} | {"total": total.detach()}
        if not bool(torch.isfinite(total)):
            # The weights stay as they are; besides, some backward kernels crash on NaN.
            return {name: float(value) for name, value in told.items()}
        self._descend("generator", total)
        for name, term in self._judge_terms(
            drawing.image.detach(), x_small, other, real, moment.fade
        ).items():
            self._descend(name, term)
            told[f"judge_{name}"] = term.detach()
        self._update_average()
        self.steps_done += 1
        # One transfer for all terms.
        values = torch.stack([value.float() for value in told.values()]).tolist()
        return dict(zip(told, values, strict=True))

    def _encoded(self, batch: Batch, resolution: int) -> tuple[Tensor, Tensor, Tensor | None]:
        """Input (B, in, S, S), target and unassociated target (B, out, R, R), if the judges see such."""
        to_cad = self.config.translator.direction == "slam2cad"
        x, y = (batch.slam, batch.cad) if to_cad else (batch.cad, batch.slam)
        other = batch.other_cad if to_cad else batch.other_slam
        unassociated = None
        if self.config.needs_unassociated and other is not None:
            unassociated = self._target(other, resolution)
        seen = self._on_device(x, self.config.translator.input_encoding)
        return seen, self._target(y, resolution), unassociated

    def _target(self, cells: ByteArray, resolution: int) -> Tensor:
        if self.config.translator.direction == "cad2slam":
            # Cells have one of three values at any resolution. The mean of a thin wall would be a pale grey, and a
            # generator that draws such a grey draws no wall at all once its values are told apart.
            cells = np.stack([resample_slam(image, (resolution, resolution)) for image in cells])
        return shrink_to(self._on_device(cells, self.config.translator.output_encoding), resolution)

    def _on_device(self, cells: ByteArray, encoding: str) -> Tensor:
        images = encode(torch.from_numpy(cells).to(self.compute.device), encoding)  # type: ignore[arg-type]
        return images.contiguous(memory_format=self.compute.memory_format)

    def _judge(self, x_small: Tensor, y: Tensor, fade: float) -> dict[str, losses.Judged]:
        """Features of pairs by both judges."""
        judged: dict[str, losses.Judged] = {}
        if "domain" in self.judges:
            judged["domain"] = self.judges["domain"](x_small, y, fade)
        if "real_fake" in self.judges:
            judged["real_fake"] = self.judges["real_fake"](y, fade)
        return judged

    def _generator_terms(
        self,
        drawing: GeneratorOutput,
        x_small: Tensor,
        y: Tensor,
        real: dict[str, losses.Judged],
        fade: float,
    ) -> dict[str, Tensor]:
        loss = self.config.loss
        fake = self._judge(x_small, drawing.image, fade)
        terms: dict[str, Tensor] = {}
        if "domain" in fake:
            if loss.domain > 0.0:
                terms["domain"] = losses.domain_loss(fake["domain"], loss.gan)
            if loss.feature_matching > 0.0:
                terms["feature_matching"] = losses.feature_matching_loss(
                    fake["domain"], real["domain"], loss.layer_weights
                )
        if "real_fake" in fake:
            if loss.real_fake > 0.0:
                terms["real_fake"] = losses.real_fake_loss(fake["real_fake"], loss.gan, loss.real_fake_scope)
            if loss.input_consistency > 0.0 and loss.input_consistency_reference != "none":
                terms["input_consistency"] = losses.input_consistency_loss(
                    fake["real_fake"], self._consistency_reference(x_small, real, fade), loss.layer_weights
                )
        if loss.l1 > 0.0:
            terms["l1"] = losses.l1_loss(drawing.image, y)
        if loss.cross_entropy > 0.0:
            terms["cross_entropy"] = losses.cross_entropy_loss(
                drawing.image, drawing.logits, y, loss.edge_weight
            )
        if loss.dice > 0.0:
            terms["dice"] = losses.dice_loss(drawing.image, y)
        if loss.smoothness > 0.0 and drawing.field is not None:
            terms["smoothness"] = roughness(drawing.field)
        return terms

    def _consistency_reference(
        self, x_small: Tensor, real: dict[str, losses.Judged], fade: float
    ) -> losses.Judged:
        if self.config.loss.input_consistency_reference == "y":
            return real["real_fake"]
        with torch.no_grad():
            return [detached(features) for features in self.judges["real_fake"](x_small, fade)]

    def _weighted(self, terms: dict[str, Tensor]) -> Tensor:
        """Eq. (1): the sum of all terms, each with its weight."""
        weights = self.config.loss
        return torch.stack([getattr(weights, name) * term for name, term in terms.items()]).sum()

    def _judge_terms(
        self,
        image: Tensor,
        x_small: Tensor,
        other: Tensor | None,
        real: dict[str, losses.Judged],
        fade: float,
    ) -> dict[str, Tensor]:
        """Losses of the judges, of eqs. (2) and (3)."""
        kind = self.config.loss.gan
        terms: dict[str, Tensor] = {}
        with self.compute.autocast():
            fake = self._judge(x_small, image, fade)
            if "domain" in fake:
                unassociated = None if other is None else self.judges["domain"](x_small, other, fade)
                terms["domain"] = losses.domain_judge_loss(real["domain"], fake["domain"], unassociated, kind)
            if "real_fake" in fake:
                terms["real_fake"] = losses.real_fake_judge_loss(real["real_fake"], fake["real_fake"], kind)
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
        if settings.weight_decay > 0.0:
            return AdamW(
                network.parameters(),
                settings.learning_rate,
                betas,
                weight_decay=settings.weight_decay,
            )
        return Adam(network.parameters(), settings.learning_rate, betas)


@contextmanager
def _frozen(networks: nn.Module) -> Iterator[None]:
    """Take weights as constants inside the block; gradients still pass through to what they are applied to."""
    networks.requires_grad_(False)
    try:
        yield
    finally:
        networks.requires_grad_(True)

"""One step of training: the generator and its discriminators, their losses and optimisers; their state as a file.

The discriminators' features of real pairs are computed once for both steps, and the discriminators' weights are frozen
while the generator's gradient passes through them, which saves a tenth of the published code's work.

The state from which a training continues bit for bit is one safetensors file: the tensors of networks and optimisers
and the state of torch's generators; everything else (settings, schedule, sampler, time used) is JSON in its header. The
file is complete or absent, and nothing in it can run code.
"""

import copy
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.nn import functional
from torch.optim import Adam, Optimizer

from slamgym.core.documents import parse_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import staged
from slamgym.core.types import ByteArray
from slamgym.gan.config import Encoding, TranslatorTrainingConfig
from slamgym.gan.device import Compute
from slamgym.gan.encoding import encode
from slamgym.gan.networks.factory import Generator, build_discriminators, build_generator
from slamgym.gan.networks.generators import GeneratorOutput
from slamgym.gan.training import losses
from slamgym.gan.training.sampler import Batch
from slamgym.gan.training.schedule import Moment
from slamgym.gan.weights import read_tensors
from slamgym.metrics.maps import resample_slam

STATE_FORMAT = "slamgym-translator-training-3"
BETA_2 = 0.99
"""Adam's second decay rate (the paper)."""


class Learner:
    """The networks in training."""

    def __init__(self, config: TranslatorTrainingConfig, compute: Compute) -> None:
        """Build networks and optimisers; equal seeds give equal weights."""
        self.config = config
        self.compute = compute
        translator = config.translator
        self.generator: Generator = compute.put(build_generator(translator, config.seed))
        self.discriminators = nn.ModuleDict()
        if config.loss.adversarial > 0.0:
            built = build_discriminators(translator, config.discriminator, config.seed)
            self.discriminators = compute.put(built)
        self.average = copy.deepcopy(self.generator) if config.optimiser.average > 0.0 else None
        self.kept = copy.deepcopy(self.generator) if config.patience > 0 else None
        self.optimisers = {"generator": self._optimiser(self.generator)}
        self.optimisers |= {
            name: self._optimiser(network) for name, network in self.discriminators.items()
        }
        self.steps_done = 0
        self.images_done = 0

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
        if self.kept is not None:
            named["kept"] = self.kept
        return named

    def keep(self) -> None:
        """Keep the generator as it is now: none before was better."""
        assert self.kept is not None  # only a training that may stop early compares
        self.kept.load_state_dict(self.best_generator.state_dict())

    def adopt(self, generator: Generator) -> None:
        """Start with the weights of a trained generator of the same settings; the discriminators start again."""
        for network in (self.generator, self.average):
            if network is not None:
                network.load_state_dict(generator.state_dict())

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
        self._set_rate(self.config.optimiser.learning_rate * moment.rate)
        resolution = moment.resolution
        fade = moment.fade
        x, y, other = self._encoded(batch, resolution)
        x_small = _shrunk(x, resolution)
        with self.compute.autocast():
            real = self._features(x_small, y, fade)
            with _frozen(self.discriminators):
                output = self.generator(x, resolution, fade)
                terms = self._generator_terms(output, x_small, y, real, fade)
        total = self._weighted(terms)
        values = {name: term.detach() for name, term in terms.items()}
        values["total"] = total.detach()
        if not bool(torch.isfinite(total)):
            # The weights stay as they are; besides, some backward kernels crash on NaN.
            return {name: float(value) for name, value in values.items()}
        self._descend("generator", total)
        image = output.image.detach()
        to_discern = self._discriminator_terms(image, x_small, other, real, fade)
        for name, term in to_discern.items():
            self._descend(name, term)
            values[f"discriminator_{name}"] = term.detach()
        self._update_average()
        self.steps_done += 1
        self.images_done += len(batch.cad)
        # One transfer for all terms.
        stacked = torch.stack([value.float() for value in values.values()])
        return dict(zip(values, stacked.tolist(), strict=True))

    def _set_rate(self, rate: float) -> None:
        for optimiser in self.optimisers.values():
            for group in optimiser.param_groups:
                group["lr"] = rate

    def _encoded(self, batch: Batch, resolution: int) -> tuple[Tensor, Tensor, Tensor | None]:
        """Input (B, in, S, S), target and unassociated target (B, out, R, R), if a discriminator sees such."""
        to_cad = self.config.translator.direction == "slam2cad"
        seen = batch.slam if to_cad else batch.cad
        wanted = batch.cad if to_cad else batch.slam
        other = batch.other_cad if to_cad else batch.other_slam
        x = self._on_device(seen, self.config.translator.input_encoding)
        y = self._target(wanted, resolution)
        unassociated = None if other is None else self._target(other, resolution)
        return x, y, unassociated

    def _target(self, cells: ByteArray, resolution: int) -> Tensor:
        translator = self.config.translator
        if translator.direction == "cad2slam":
            # Cells have one of three values at any resolution. The mean of a thin wall would be a pale grey, and a
            # generator that learns such a grey gives no wall at all once its values are classified.
            cells = np.stack([resample_slam(image, (resolution, resolution)) for image in cells])
        images = self._on_device(cells, translator.output_encoding)
        return _shrunk(images, resolution)

    def _on_device(self, cells: ByteArray, encoding: Encoding) -> Tensor:
        on_device = torch.from_numpy(cells).to(self.compute.device)
        images = encode(on_device, encoding)
        return images.contiguous(memory_format=self.compute.memory_format)

    def _features(self, x_small: Tensor, y: Tensor, fade: float) -> dict[str, losses.Features]:
        """Features of pairs, by each discriminator."""
        if not self.discriminators:
            return {}
        return {
            "domain": self.discriminators["domain"](x_small, y, fade),
            "real_fake": self.discriminators["real_fake"](y, fade),
        }

    def _generator_terms(
        self,
        output: GeneratorOutput,
        x_small: Tensor,
        y: Tensor,
        real: dict[str, losses.Features],
        fade: float,
    ) -> dict[str, Tensor]:
        weights = self.config.loss
        terms: dict[str, Tensor] = {}
        fake = self._features(x_small, output.image, fade)
        if fake:
            form = weights.form
            terms["domain"] = losses.taken_for_real_loss(fake["domain"], form)
            terms["feature_matching"] = losses.feature_matching_loss(
                fake["domain"], real["domain"], form
            )
            terms["real_fake"] = losses.taken_for_real_loss(fake["real_fake"], form)
            terms["input_consistency"] = losses.feature_matching_loss(
                fake["real_fake"], real["real_fake"], form
            )
        if weights.l1 > 0.0:
            terms["l1"] = losses.l1_loss(output.image, y)
        if weights.overlap > 0.0:
            assert output.logits is not None  # only layers are compared by overlap
            terms["cross_entropy"] = losses.cross_entropy_loss(output.logits, y)
            terms["dice"] = losses.dice_loss(output.image, y)
        return terms

    def _weighted(self, terms: dict[str, Tensor]) -> Tensor:
        """Eq. (1): the sum of all terms, each with its weight."""
        loss = self.config.loss
        weights = {"l1": loss.l1, "cross_entropy": loss.overlap, "dice": loss.overlap}
        weighted = [weights.get(name, loss.adversarial) * term for name, term in terms.items()]
        return torch.stack(weighted).sum()

    def _discriminator_terms(
        self,
        image: Tensor,
        x_small: Tensor,
        other: Tensor | None,
        real: dict[str, losses.Features],
        fade: float,
    ) -> dict[str, Tensor]:
        """Losses of the discriminators, of eqs. (2) and (3)."""
        terms = {}
        with self.compute.autocast():
            for name, fake in self._features(x_small, image, fade).items():
                fakes = [fake]
                if name == "domain" and other is not None:
                    unassociated = self.discriminators[name](x_small, other, fade)
                    fakes.append(unassociated)
                terms[name] = losses.discriminator_loss(real[name], fakes, self.config.loss.form)
        return terms

    def _descend(self, name: str, loss: Tensor) -> None:
        optimiser = self.optimisers[name]
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        largest = self.config.optimiser.clip_norm
        if name == "generator" and largest > 0.0:
            nn.utils.clip_grad_norm_(self.generator.parameters(), largest)
        optimiser.step()

    def _update_average(self) -> None:
        if self.average is None:
            return
        # Early on the average must not hang on to the first, random weights.
        early = (1.0 + self.steps_done) / (10.0 + self.steps_done)
        keep = min(self.config.optimiser.average, early)
        parameters = zip(self.average.parameters(), self.generator.parameters(), strict=True)
        buffers = zip(self.average.buffers(), self.generator.buffers(), strict=True)
        with torch.no_grad():
            for mean, now in parameters:
                mean.lerp_(now, 1.0 - keep)
            for mean_buffer, buffer in buffers:
                mean_buffer.copy_(buffer)

    def _optimiser(self, network: nn.Module) -> Optimizer:
        settings = self.config.optimiser
        return Adam(network.parameters(), settings.learning_rate, (settings.beta1, BETA_2))

    def save(self, path: Path, facts: dict[str, Any]) -> None:
        """Write the state.

        Args:
            path: The file; it is replaced at once.
            facts: JSON values: what else the training needs to continue.

        Raises:
            InputFileError: If it can't be written.
        """
        plain = {}
        for name, value in self._tensors().items():
            plain[name] = value.detach().cpu().contiguous().clone()
        done = {"steps_done": self.steps_done, "images_done": self.images_done}
        header = {"format": STATE_FORMAT, "facts": json.dumps(facts | done)}
        with staged(path) as part:
            save_file(plain, part, metadata=header)

    def _tensors(self) -> dict[str, Tensor]:
        """The tensors of the state, by the names that :meth:`restore` reads."""
        tensors = {"torch.cpu": torch.get_rng_state()}
        if self.compute.device.type == "cuda":
            tensors["torch.cuda"] = torch.cuda.get_rng_state(self.compute.device)
        for name, network in self.networks().items():
            for key, value in network.state_dict().items():
                tensors[f"network.{name}.{key}"] = value
        for name, optimiser in self.optimisers.items():
            # Adam's moments and step counts, by the parameter's number; parameters not moved yet have none.
            for number, state in optimiser.state_dict()["state"].items():
                for key, value in state.items():
                    tensors[f"optimiser.{name}.{number}.{key}"] = value
        return tensors

    def restore(self, tensors: dict[str, Tensor], facts: dict[str, Any]) -> None:
        """Put a state into networks and optimisers of the same settings, and into torch's generators.

        Raises:
            RuntimeError: If the state doesn't fit; or KeyError, or ValueError.
        """
        for name, network in self.networks().items():
            network.load_state_dict(_below(tensors, f"network.{name}."))
        for name, optimiser in self.optimisers.items():
            state = _by_parameter(_below(tensors, f"optimiser.{name}."))
            groups = optimiser.state_dict()["param_groups"]
            optimiser.load_state_dict({"state": state, "param_groups": groups})
        torch.set_rng_state(tensors["torch.cpu"])
        if "torch.cuda" in tensors and self.compute.device.type == "cuda":
            torch.cuda.set_rng_state(tensors["torch.cuda"], self.compute.device)
        self.steps_done = int(facts["steps_done"])
        self.images_done = int(facts["images_done"])


def load_training_state(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read a file that :meth:`Learner.save` wrote: its tensors and facts.

    Raises:
        InputFileError: If it is missing, damaged or no checkpoint of a training.
    """
    header, tensors = read_tensors(path)
    if header.get("format") != STATE_FORMAT:
        raise InputFileError(
            path,
            "is not a checkpoint of this version of `slamgym gan train`; train in another folder (-o)",
        )
    facts = parse_json(header.get("facts", ""), path)
    if not isinstance(facts, dict):
        raise InputFileError(
            path, "is damaged: its facts are no object; train in another folder (-o)"
        )
    return tensors, facts


def _below(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin so, by the rest of their names."""
    below = {}
    for key, value in tensors.items():
        if key.startswith(prefix):
            below[key.removeprefix(prefix)] = value
    return below


def _by_parameter(tensors: dict[str, Tensor]) -> dict[int, dict[str, Tensor]]:
    """An optimiser's state by the number of the parameter, from tensors named ``NUMBER.KEY``."""
    state: dict[int, dict[str, Tensor]] = {}
    for path, value in tensors.items():
        number, key = path.split(".", 1)
        state.setdefault(int(number), {})[key] = value
    return state


def _shrunk(images: Tensor, side: int) -> Tensor:
    """Area mean down to (B, C, side, side); thin walls grow pale rather than vanish."""
    factor = images.shape[-1] // side
    if factor <= 1:
        return images
    return functional.avg_pool2d(images, factor)


@contextmanager
def _frozen(networks: nn.Module) -> Iterator[None]:
    """Take weights as constants inside the block; gradients still pass through to what they are applied to."""
    networks.requires_grad_(False)
    try:
        yield
    finally:
        networks.requires_grad_(True)

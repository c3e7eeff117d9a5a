"""The state of a training in one file, from which it goes on bit for bit.

A safetensors file: the tensors of networks and optimisers and the state of torch's generators; everything else
(settings, schedule, sampler, time used) is JSON in its header. The file is complete or absent, and nothing in
it can run code.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.optim import Optimizer

from slamgym.core.documents import load_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import staged
from slamgym.gan.training.learner import Learner

STATE_FORMAT = "slamgym-translator-training-2"


@dataclass(frozen=True)
class TrainingState:
    """What a file holds."""

    tensors: dict[str, Tensor]
    facts: dict[str, Any]


def save_training_state(path: Path, learner: Learner, facts: dict[str, Any]) -> None:
    """Write the state.

    Args:
        path: The file; it is replaced at once.
        learner: Networks and optimisers.
        facts: JSON values: whatever the training needs to go on.

    Raises:
        InputFileError: If it can't be written.
    """
    tensors = {"torch.cpu": torch.get_rng_state()}
    if learner.compute.device.type == "cuda":
        tensors["torch.cuda"] = torch.cuda.get_rng_state(learner.compute.device)
    for name, network in learner.networks().items():
        tensors |= {f"network.{name}.{key}": value for key, value in network.state_dict().items()}
    for name, optimiser in learner.optimisers.items():
        tensors |= _optimiser_tensors(name, optimiser)
    plain = {key: value.detach().cpu().contiguous().clone() for key, value in tensors.items()}
    header = {"format": STATE_FORMAT, "facts": json.dumps({**facts, "steps_done": learner.steps_done})}
    with staged(path) as part:
        save_file(plain, part, metadata=header)


def load_training_state(path: Path) -> TrainingState:
    """Read a file.

    Raises:
        InputFileError: If it is missing, damaged or no checkpoint of a training.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            if header.get("format") != STATE_FORMAT:
                raise InputFileError(
                    path,
                    "is not a checkpoint of this version of `slamgym gan train`; train in another folder (-o)",
                )
            facts = load_json(header["facts"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 - not a mapping
            if not isinstance(facts, dict):
                raise ValueError("its facts are no object")
    except (SafetensorError, OSError, ValueError, KeyError) as error:
        raise InputFileError(
            path, f"is damaged or no checkpoint ({error}); train in another folder (-o)"
        ) from error
    return TrainingState(tensors, facts)


def restore_training_state(state: TrainingState, learner: Learner) -> None:
    """Put a state into networks and optimisers of the same settings, and into torch's generators.

    Raises:
        ConfigError: If the state doesn't fit.
    """
    tensors = state.tensors
    for name, network in learner.networks().items():
        _load_network(network, _below(tensors, f"network.{name}."), name)
    for name, optimiser in learner.optimisers.items():
        _load_optimiser(optimiser, _below(tensors, f"optimiser.{name}."))
    torch.set_rng_state(tensors["torch.cpu"])
    if "torch.cuda" in tensors and learner.compute.device.type == "cuda":
        torch.cuda.set_rng_state(tensors["torch.cuda"], learner.compute.device)
    learner.steps_done = int(state.facts["steps_done"])


def _below(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}


def _load_network(network: nn.Module, state: dict[str, Tensor], name: str) -> None:
    try:
        network.load_state_dict(state)
    except RuntimeError as error:
        raise ConfigError(f"the checkpoint's {name} has other shapes than these settings give") from error


def _optimiser_tensors(name: str, optimiser: Optimizer) -> dict[str, Tensor]:
    """Adam's moments and step counts, by the parameter's number; parameters not moved yet have none."""
    return {
        f"optimiser.{name}.{number}.{key}": value
        for number, state in optimiser.state_dict()["state"].items()
        for key, value in state.items()
    }


def _load_optimiser(optimiser: Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        number, key = name.split(".", 1)
        state.setdefault(int(number), {})[key] = value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})

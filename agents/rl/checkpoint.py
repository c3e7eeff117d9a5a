"""What a run of an agent's training needs to go on, as a safetensors file: reading it can run no code.

Its tensors are the weights, the optimisers' moments, and what normalises observations; steps and the optimisers'
settings are JSON in its header.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from slamgym.core.documents import load_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import require_file, staged
from slamgym.core.limits import WEIGHT_BYTES

CHECKPOINT = "checkpoint.safetensors"
"""Name of the checkpoint in the folder of a run."""
CHECKPOINT_FORMAT = "slamgym-agent-training-1"
_DAMAGES = (SafetensorError, OSError, RuntimeError, LookupError, TypeError, ValueError)
"""Errors from reading a checkpoint that is cut off or belongs to another network."""


def save_checkpoint(folder: Path, model: Any) -> None:
    """Save what a run needs to go on: weights, optimiser, steps, and what normalises its observations.

    Args:
        folder: Of the run.
        model: The learner of Stable-Baselines3.
    """
    tensors: dict[str, Tensor] = {}
    groups: dict[str, Any] = {}
    for name, state in model.get_parameters().items():
        if "param_groups" in state:
            groups[name] = state["param_groups"]
        for key, value in _flat(state):
            tensors[f"{name}/{key}"] = value.detach().cpu().contiguous().clone()
    for name, statistics in _statistics(model).items():
        for key in ("mean", "var", "count"):
            tensors[f"{name}/{key}"] = torch.as_tensor(getattr(statistics, key)).clone()
    facts = {"steps": model.num_timesteps, "updates": model._n_updates, "groups": groups}
    header = {"format": CHECKPOINT_FORMAT, "facts": json.dumps(facts)}
    with staged(folder / CHECKPOINT) as part:
        save_file(tensors, part, metadata=header)


def load_checkpoint(folder: Path, model: Any) -> None:
    """Continue a run in a fresh learner of the same configuration.

    Args:
        folder: Of the run.
        model: Its counters, weights and optimiser are replaced.

    Raises:
        InputFileError: If the file is damaged or belongs to another network.
    """
    path = folder / CHECKPOINT
    require_file(path, WEIGHT_BYTES)
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
        if header.get("format") != CHECKPOINT_FORMAT:
            raise ValueError("it is of another version")
        facts = load_json(header["facts"])
        parameters = {}
        for name in model.get_parameters():
            own = _below(tensors, f"{name}/")
            groups = facts["groups"].get(name)
            parameters[name] = own if groups is None else _optimiser_state(own, groups)
        model.set_parameters(parameters)
        for name, statistics in _statistics(model).items():
            for key, value in _below(tensors, f"{name}/").items():
                setattr(statistics, key, value.numpy())
        model.num_timesteps = int(facts["steps"])
        model._n_updates = int(facts["updates"])
    except _DAMAGES as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputFileError(
            path, f"is no checkpoint of this run ({reason}); delete it to begin again"
        ) from None


def _flat(state: Mapping[str, Any]) -> Iterator[tuple[str, Tensor]]:
    """The tensors of a network's state, or of an optimiser's by ``NUMBER/NAME``."""
    if "param_groups" not in state:
        yield from state.items()
        return
    for number, moments in state["state"].items():
        for name, value in moments.items():
            yield f"{number}/{name}", value


def _below(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin so, by the rest of their names."""
    return {key.removeprefix(prefix): tensors[key] for key in tensors if key.startswith(prefix)}


def _optimiser_state(tensors: Mapping[str, Tensor], groups: Any) -> dict[str, Any]:
    """An optimiser's state as torch has it."""
    state: dict[int, dict[str, Tensor]] = {}
    for path, value in tensors.items():
        number, name = path.split("/", 1)
        state.setdefault(int(number), {})[name] = value
    return {"state": state, "param_groups": groups}


def _statistics(model: Any) -> dict[str, Any]:
    """Statistics that normalise observations and rewards, where the environments do that."""
    envs = model.get_vec_normalize_env()
    return {} if envs is None else {"observations": envs.obs_rms, "returns": envs.ret_rms}

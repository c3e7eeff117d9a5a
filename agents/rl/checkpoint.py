"""Checkpoints of a training run: weights, optimiser and steps. Loading one executes no pickle."""

from pathlib import Path
from typing import Any

import torch

from slamgym.core.errors import InputFileError
from slamgym.core.files import staged
from slamgym.core.limits import WEIGHT_BYTES
from slamgym.core.streams import check_zip

CHECKPOINT = "checkpoint.pt"


def save_checkpoint(folder: Path, model: Any) -> None:
    """Save what a run needs to go on.

    Args:
        folder: Of the run.
        model: A Stable-Baselines3 algorithm.
    """
    state = {"steps": model.num_timesteps, "updates": getattr(model, "_n_updates", 0)}
    state |= {name: module.state_dict() for name, module in _modules(model).items()}
    state |= {name: getattr(model, name).detach().clone() for name in _tensors(model)}
    for name, statistics in _statistics(model).items():
        numbers = {key: torch.as_tensor(getattr(statistics, key)) for key in _STATISTICS}
        state[name] = numbers
    with staged(folder / CHECKPOINT) as part:
        torch.save(state, part)


def load_checkpoint(folder: Path, model: Any) -> None:
    """Continue a run in a fresh model of the same configuration.

    Args:
        folder: Of the run.
        model: Its counters, weights and optimisers are replaced.

    Raises:
        InputFileError: If the file is damaged or belongs to another network.
    """
    path = folder / CHECKPOINT
    try:
        check_zip(path, WEIGHT_BYTES)
        state = torch.load(path, map_location="cpu", weights_only=True)
        for name, module in _modules(model).items():
            module.load_state_dict(state[name])
        for name in _tensors(model):
            getattr(model, name).data.copy_(state[name])
        for name, statistics in _statistics(model).items():
            for key in _STATISTICS:
                setattr(statistics, key, state[name][key].numpy())
        model.num_timesteps = int(state["steps"])
        model._n_updates = int(state["updates"])
    except (
        OSError,
        RuntimeError,
        LookupError,
        TypeError,
        ValueError,
        EOFError,
        AttributeError,
        _unpickling_error(),
    ) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputFileError(
            path, f"is no checkpoint of this run ({reason}); delete it to begin again"
        ) from None


def has_checkpoint(folder: Path) -> bool:
    """Whether a run can be continued."""
    return (folder / CHECKPOINT).is_file()


def _modules(model: Any) -> dict[str, Any]:
    """Everything with a state: networks and optimisers, by stable names."""
    parts = {"policy": model.policy}
    names, _ = model._get_torch_save_params()
    for name in (name for name in names if name.endswith("optimizer")):
        part = model
        for attribute in name.split("."):
            part = getattr(part, attribute)
        parts[name] = part
    return parts


def _tensors(model: Any) -> list[str]:
    """Learned numbers that belong to no network, such as the entropy's weight in SAC."""
    _, names = model._get_torch_save_params()
    return [name for name in names if isinstance(getattr(model, name, None), torch.Tensor)]


_STATISTICS = ("mean", "var", "count")


def _statistics(model: Any) -> dict[str, Any]:
    """What normalises observations and rewards, where the environments do."""
    envs = model.get_vec_normalize_env()
    return {} if envs is None else {"observations": envs.obs_rms, "returns": envs.ret_rms}


def _unpickling_error() -> type[Exception]:
    import pickle

    return pickle.UnpicklingError

"""The network that drives the wheels, without torch, and its weights on disk."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.pretrained_policy import (
    fingerprint_of,
    read_tensors,
    refuse_other_shapes,
    write_weights,
)
from slamgym.core.config import Count, Positive, Settings, from_dict, to_dict
from slamgym.core.documents import load_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.portable import product
from slamgym.core.provenance import check_origin
from slamgym.core.types import Float32Array
from slamgym.envs.compact import BLOCKS, SCAN_SECTORS, compact_size
from slamgym.envs.far_look import FAR_SIZE, SECTORS

WHEELS = Path(__file__).parents[1] / "pretrained" / "wheels_policy.safetensors"
"""The policy that comes with the package."""

CLIP = 5.0
"""Normalised observations are cut off here."""
_EPSILON = 1e-8


class WheelsNetwork(Settings, section="network"):
    """What the network takes in, and its size."""

    crop_side: Positive = 8.4
    """Side of the map's crop [m]."""
    hold: Count = 3
    """An action holds for so many control steps."""
    first: Count = 256
    """Units of the first layer, which action and value share."""
    second: Count = 128
    """Units of the second layer of each."""


_SPACE = {
    "env": "slamgym/Explore-v1",
    "preset": "compact_far",
    "blocks": BLOCKS,
    "ranges": SCAN_SECTORS,
    "sectors": SECTORS,
}


@dataclass(frozen=True)
class WheelsPolicy:
    """Weights and what they are for."""

    network: WheelsNetwork
    weights: Mapping[str, Float32Array]
    about: Mapping[str, Any]  # how they were trained

    @property
    def fingerprint(self) -> str:
        """The first 12 hex digits of the SHA-256 of the weights in the order of their names."""
        return fingerprint_of(self.weights)

    def act(self, observation: Float32Array) -> Float32Array:
        """Shares of the largest speed and turning rate, shape (..., 2) in [-1, 1].

        Args:
            observation: Of the preset ``compact_far``, shape (..., n).
        """
        w = self.weights
        scaled = (observation - w["mean"]) / np.sqrt(w["variance"] + np.float32(_EPSILON))
        hidden = np.clip(scaled, -CLIP, CLIP).reshape(-1, scaled.shape[-1])
        for name, layer in self._layers.items():
            hidden = product(hidden, layer) + w[f"{name}.bias"]
            hidden = np.clip(hidden, -1.0, 1.0) if name == "action" else np.maximum(hidden, 0.0)
        return hidden.reshape(*observation.shape[:-1], 2)

    @functools.cached_property
    def _layers(self) -> dict[str, Float32Array]:
        """The weights of each layer as :func:`product` takes them, (inputs, outputs)."""
        return {
            name: np.ascontiguousarray(self.weights[f"{name}.weight"].T)
            for name in ("first", "second", "action")
        }


def shapes(network: WheelsNetwork) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights."""
    size = compact_size(SCAN_SECTORS) + FAR_SIZE
    found: dict[str, tuple[int, ...]] = {"mean": (size,), "variance": (size,)}
    sizes = (size, network.first, network.second, 2)
    for name, inputs, outputs in zip(("first", "second", "action"), sizes, sizes[1:], strict=False):
        found |= {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
    return found


def write_wheels(path: Path, policy: WheelsPolicy) -> None:
    """Write weights with their description, also as JSON beside them."""
    description = {"space": _SPACE, "network": to_dict(policy.network), "about": dict(policy.about)}
    write_weights(path, policy.weights, description)


def read_wheels(path: Path | str = WHEELS) -> WheelsPolicy:
    """Read weights and check that they fit this version's observations.

    Raises:
        InputFileError: If the file is missing, damaged, or made for another observation.
    """
    path = Path(path)
    check_origin(path)
    metadata, weights = read_tensors(path)
    try:
        description = load_json(metadata["slamgym"])
        space, about = description["space"], description["about"]
        network = from_dict(WheelsNetwork, description["network"], "network")
    except (KeyError, TypeError, ValueError, ConfigError):
        raise InputFileError(
            path, "holds no policy that drives the wheels; slamgym agents train --env explore writes one"
        ) from None
    if space != _SPACE:
        raise InputFileError(
            path, f"was trained on other observations ({space}, this version has {_SPACE}); train again"
        )
    refuse_other_shapes(path, weights, shapes(network))
    return WheelsPolicy(network, weights, about)

"""Weights of a frontier policy on disk: a safetensors file with its configuration in the header.

Reading one executes nothing. The header names the version of the features and the sizes of the network, so
that weights of another observation space are refused with one sentence.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from slamgym.agents.scoring import FrontierScorer, NetworkConfig
from slamgym.core.config import from_dict, to_dict
from slamgym.core.documents import load_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import require_file, write_bytes, write_text
from slamgym.core.limits import WEIGHT_BYTES
from slamgym.core.provenance import check_origin
from slamgym.core.types import Float32Array
from slamgym.envs.frontier_features import (
    CROP_PX,
    FEATURE_VERSION,
    GLOBAL_FEATURES,
)

PRETRAINED = Path(__file__).parent / "pretrained" / "frontier_policy.safetensors"
"""The policy that comes with the package."""


@dataclass(frozen=True)
class PolicyFile:
    """Weights and what they are for."""

    network: NetworkConfig
    weights: Mapping[str, Float32Array]
    about: Mapping[str, Any]  # how they were trained

    @property
    def fingerprint(self) -> str:
        """The first 12 hex digits of the SHA-256 of the weights in the order of their names."""
        return fingerprint_of(self.weights)

    def scorer(self) -> FrontierScorer:
        """The network, ready to choose."""
        return FrontierScorer(self.weights, self.network.heads)


def fingerprint_of(weights: Mapping[str, Float32Array]) -> str:
    """The first 12 hex digits of the SHA-256 of weights in the order of their names."""
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(name.encode() + np.ascontiguousarray(weights[name], "<f4").tobytes())
    return digest.hexdigest()[:12]


def write_policy(
    path: Path, network: NetworkConfig, weights: Mapping[str, Float32Array], about: Mapping[str, Any]
) -> None:
    """Write weights as safetensors and their configuration as JSON beside them.

    Args:
        path: The ``.safetensors`` file.
        network: Sizes.
        weights: By the names of the network's parameters.
        about: How they were trained.
    """
    write_weights(
        path, weights, {"space": _space(network), "network": to_dict(network), "about": dict(about)}
    )


def write_weights(path: Path, weights: Mapping[str, Float32Array], description: Mapping[str, Any]) -> None:
    """Write weights as safetensors with their description in the header, and that as JSON beside them."""
    tensors = {name: np.ascontiguousarray(value, dtype="<f4") for name, value in weights.items()}
    write_bytes(path, save(tensors, {"slamgym": json.dumps(description, sort_keys=True)}))
    write_text(path.with_suffix(".json"), json.dumps(description, indent=2, sort_keys=True) + "\n")


def read_policy(path: Path | str = PRETRAINED) -> PolicyFile:
    """Read weights and check that they fit this version's observations.

    Raises:
        InputFileError: If the file is missing, damaged, or made for another observation space.
    """
    path = Path(path)
    check_origin(path)
    metadata, weights = read_tensors(path)
    try:
        configuration = load_json(metadata["slamgym"])
        space, about = configuration["space"], configuration["about"]
    except (KeyError, TypeError, ValueError):
        raise InputFileError(path, "holds no frontier policy; slamgym agents train writes one") from None
    try:
        network = from_dict(NetworkConfig, configuration["network"], "network")
    except (KeyError, ConfigError) as error:
        raise InputFileError(path, f"describes no network that this version knows ({error})") from None
    _refuse_other_space(path, space, network)
    refuse_other_shapes(path, weights, weight_shapes(network))
    return PolicyFile(network, weights, about)


def _space(network: NetworkConfig) -> dict[str, Any]:
    """What the weights take in."""
    return {
        "env": "slamgym/ExploreFrontiers-v1",
        "feature_version": FEATURE_VERSION,
        "candidate_features": list(network.candidate_features),
        "global_features": list(GLOBAL_FEATURES),
        "crop_px": CROP_PX,
    }


def _refuse_other_space(path: Path, space: Any, network: NetworkConfig) -> None:
    ours = _space(network)
    if not isinstance(space, dict):
        raise InputFileError(path, "doesn't say which observations it was trained on")
    for name, value in ours.items():
        if space.get(name) != value:
            theirs, mine = space.get(name), value
            if isinstance(mine, list):
                count = len(theirs) if isinstance(theirs, list) else "no"
                theirs, mine = f"{count} features", f"{len(mine)}, or others"
            raise InputFileError(
                path,
                f"was trained on another observation space ({name} {theirs}, this version has {mine}); "
                "train again or use the version it was made with",
            )


def read_tensors(path: Path) -> tuple[dict[str, str], dict[str, Float32Array]]:
    """The metadata of a safetensors file and its tensors, which must be single precision and finite."""
    require_file(path, WEIGHT_BYTES)
    try:
        with safe_open(path, framework="np") as file:
            weights: dict[str, Float32Array] = {}
            for name in file.keys():  # noqa: SIM118 - not a mapping
                if file.get_slice(name).get_dtype() != "F32":
                    raise InputFileError(path, f"is damaged at {name!r}; download or train it again")
                weights[name] = file.get_tensor(name)
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise InputFileError(
            path, f"is no whole safetensors file ({error}); download or train it again"
        ) from None
    for name, array in weights.items():
        if not np.isfinite(array).all():
            raise InputFileError(path, f"has weights that are no numbers at {name!r}; train it again")
    return metadata, weights


def weight_shapes(network: NetworkConfig) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights."""
    features, overall, width = len(network.candidate_features), len(GLOBAL_FEATURES), network.width
    linear = {
        "crop": (2 * CROP_PX * CROP_PX, network.crop),
        "embed_in": (features + network.crop + overall, width),
        "embed_out": (width, width),
        "query_key_value": (width, 3 * width),
        "attended": (width, width),
        "score_in": (3 * width, width),
        "score_out": (width, 1),
    }
    shapes: dict[str, tuple[int, ...]] = {
        "prior.weight": (1, features),
        "norm.weight": (width,),
        "norm.bias": (width,),
    }
    for name, (inputs, outputs) in linear.items():
        shapes |= {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}
    return shapes


def refuse_other_shapes(
    path: Path, weights: Mapping[str, Float32Array], shapes: Mapping[str, tuple[int, ...]]
) -> None:
    """Refuse weights that lack some or have others than the sizes of the network ask for.

    Raises:
        InputFileError: Naming one of them.
    """
    for name, shape in shapes.items():
        if name not in weights or weights[name].shape != shape:
            there = f"has shape {weights[name].shape}" if name in weights else "is missing"
            raise InputFileError(path, f"{name} {there} where its configuration asks for {shape}")

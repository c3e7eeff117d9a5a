"""Weights of a frontier policy on disk: a safetensors file with its configuration in the header.

Reading one executes nothing. The header names the version of the features and the sizes of the network, so
that weights of another observation space are refused with one sentence.
"""

import hashlib
import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.scoring import FrontierScorer, NetworkConfig
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_bytes, write_bytes, write_text
from slamgym.core.types import Float32Array
from slamgym.envs.frontier_features import (
    CANDIDATE_FEATURES,
    CROP_PX,
    FEATURE_VERSION,
    GLOBAL_FEATURES,
)

PRETRAINED = Path(__file__).parent / "pretrained" / "frontier_policy.safetensors"
"""The policy that comes with the package."""

MAX_HEADER = 1 << 20


@dataclass(frozen=True)
class PolicyFile:
    """Weights and what they are for."""

    network: NetworkConfig
    weights: Mapping[str, Float32Array]
    about: Mapping[str, Any]  # how they were trained

    @property
    def fingerprint(self) -> str:
        """The first 12 hex digits of the SHA-256 of the weights in the order of their names."""
        digest = hashlib.sha256()
        for name in sorted(self.weights):
            digest.update(name.encode() + np.ascontiguousarray(self.weights[name], "<f4").tobytes())
        return digest.hexdigest()[:12]

    def scorer(self) -> FrontierScorer:
        """The network, ready to choose."""
        return FrontierScorer(self.weights, self.network.heads)


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
    configuration = {"space": _space(), "network": to_dict(network), "about": dict(about)}
    header: dict[str, Any] = {"__metadata__": {"slamgym": json.dumps(configuration, sort_keys=True)}}
    chunks, offset = [], 0
    for name in sorted(weights):
        content = np.ascontiguousarray(weights[name], dtype="<f4").tobytes()
        header[name] = {
            "dtype": "F32",
            "shape": list(weights[name].shape),
            "data_offsets": [offset, offset + len(content)],
        }
        chunks.append(content)
        offset += len(content)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    write_bytes(path, struct.pack("<Q", len(text)) + text + b"".join(chunks))
    write_text(path.with_suffix(".json"), json.dumps(configuration, indent=2, sort_keys=True) + "\n")


def read_policy(path: Path | str = PRETRAINED) -> PolicyFile:
    """Read weights and check that they fit this version's observations.

    Raises:
        InputFileError: If the file is missing, damaged, or made for another observation space.
    """
    path = Path(path)
    content = read_bytes(path)
    header, body = _split_header(path, content)
    try:
        configuration = json.loads(header.pop("__metadata__")["slamgym"])
        space, about = configuration["space"], configuration["about"]
    except (KeyError, TypeError, ValueError):
        raise InputFileError(path, "holds no frontier policy; slamgym agents train writes one") from None
    _refuse_other_space(path, space)
    try:
        network = from_dict(NetworkConfig, configuration["network"], f"{path}: network")
    except (KeyError, TypeError, ConfigError) as error:
        raise InputFileError(path, f"describes no network that this version knows ({error})") from None
    weights = {name: _array(path, name, entry, body) for name, entry in header.items()}
    _refuse_other_shapes(path, network, weights)
    return PolicyFile(network, weights, about)


def _space() -> dict[str, Any]:
    """What the weights take in."""
    return {
        "env": "slamgym/ExploreFrontiers-v0",
        "feature_version": FEATURE_VERSION,
        "candidate_features": list(CANDIDATE_FEATURES),
        "global_features": list(GLOBAL_FEATURES),
        "crop_px": CROP_PX,
    }


def _refuse_other_space(path: Path, space: Any) -> None:
    ours = _space()
    if not isinstance(space, dict):
        raise InputFileError(path, "doesn't say which observations it was trained on")
    for name, value in ours.items():
        if space.get(name) != value:
            theirs, mine = space.get(name), value
            if isinstance(mine, list):
                theirs, mine = f"{len(theirs or [])} features", f"{len(mine)}, or others"
            raise InputFileError(
                path,
                f"was trained on another observation space ({name} {theirs}, this version has {mine}); "
                "train again or use the version it was made with",
            )


def _split_header(path: Path, content: bytes) -> tuple[dict[str, Any], bytes]:
    """The header of a safetensors file and its data (huggingface.co/docs/safetensors, "Format")."""
    damaged = InputFileError(path, "is no whole safetensors file; download or train it again")
    if len(content) < 8:
        raise damaged
    (length,) = struct.unpack("<Q", content[:8])
    if length > min(MAX_HEADER, len(content) - 8):
        raise damaged
    try:
        header = json.loads(content[8 : 8 + length])
    except ValueError:
        raise damaged from None
    if not isinstance(header, dict):
        raise damaged
    return header, content[8 + length :]


def _array(path: Path, name: str, entry: Any, body: bytes) -> Float32Array:
    try:
        begin, end = entry["data_offsets"]
        if entry["dtype"] != "F32" or not 0 <= begin <= end <= len(body):
            raise ValueError
        array = np.frombuffer(body[begin:end], dtype="<f4").reshape(entry["shape"]).astype(np.float32)
    except (KeyError, TypeError, ValueError):
        raise InputFileError(path, f"is damaged at {name!r}; download or train it again") from None
    if not np.isfinite(array).all():
        raise InputFileError(path, f"has weights that are no numbers at {name!r}; train it again")
    return array


def _refuse_other_shapes(path: Path, network: NetworkConfig, weights: Mapping[str, Float32Array]) -> None:
    """Compare with the shapes that the sizes of the network ask for."""
    features, overall, width = len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES), network.width
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
    for name, shape in shapes.items():
        if name not in weights or weights[name].shape != shape:
            there = f"has shape {weights[name].shape}" if name in weights else "is missing"
            raise InputFileError(path, f"{name} {there} where its configuration asks for {shape}")

"""Weights of policies on disk, safetensors files with their configuration in the header, and the explorer ``rl:FILE``.

Reading one executes nothing. The header names what the network takes in and its sizes, so that weights of another
observation space are refused with one sentence.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load_file, save

from slamgym.agents.explorer import BatchedExplorer, FrontierPilot
from slamgym.agents.scoring import (
    ATTENTION_BLOCKS,
    HEADS,
    LINEAR_LAYERS,
    NORMS,
    WIDTH,
    FrontierScorer,
)
from slamgym.core.config import config_hash
from slamgym.core.documents import load_json, read_json
from slamgym.core.errors import InputFileError
from slamgym.core.files import require_file, write_bytes, write_text
from slamgym.core.limits import WEIGHT_BYTES
from slamgym.core.provenance import check_origin
from slamgym.core.types import Float32Array
from slamgym.envs.frontier_features import (
    CANDIDATE_FEATURES,
    FEATURE_VERSION,
    GLOBAL_FEATURES,
    MOST_FRONTIERS,
    FrontierFeatures,
)
from slamgym.planning.context import ExplorerContext
from slamgym.planning.exploration_loop import ExplorationLoop, ExplorationLoopConfig
from slamgym.planning.promise import Promise

FRONTIER_POLICY = Path(__file__).parent / "pretrained" / "frontier_policy.safetensors"
"""The policy that comes with the package."""
_SPACE = {
    "env": "slamgym/ExploreFrontiers",
    "feature_version": FEATURE_VERSION,
    "candidate_features": list(CANDIDATE_FEATURES),
    "global_features": list(GLOBAL_FEATURES),
}
"""Observations that the weights take in."""
_NETWORK = {"width": WIDTH, "heads": HEADS, "blocks": ATTENTION_BLOCKS}
"""Description of the network in files."""


def policy_loop(promise: Promise | None) -> ExplorationLoopConfig:
    """How frontiers are offered to a policy."""
    return ExplorationLoopConfig(max_candidates=MOST_FRONTIERS, promise=promise)


class LearnedExplorer(BatchedExplorer):
    """Chooses frontiers by a trained network, on the loop and the features that it learned with; without torch.

    Args:
        context: What the environment says about the robot and its map.
        policy: Weights, as ``slamgym agents train frontiers`` writes them.
        config: How frontiers are offered and driven to.

    Raises:
        InputFileError: If the weights are missing, damaged, or made for other observations.
    """

    def __init__(
        self,
        context: ExplorerContext,
        policy: Path | str,
        config: ExplorationLoopConfig | None = None,
    ) -> None:
        self.config = loop = config or policy_loop(None)
        weights, _ = read_policy(policy)
        scorer = FrontierScorer(weights)
        fingerprint = f"{fingerprint_of(weights)}-{config_hash(loop)}"
        super().__init__(context, fingerprint, lambda _: LearnedPilot(context, loop, scorer))


class LearnedPilot(FrontierPilot):
    """Drives one robot.

    Args:
        context: What the environment says about the robot and its map.
        config: How frontiers are offered and driven to. *Done* is listened to where it was learned: at the promise
            98%:95%.
        scorer: The network.
    """

    def __init__(
        self, context: ExplorerContext, config: ExplorationLoopConfig, scorer: FrontierScorer
    ) -> None:
        super().__init__(context, config, self._scores)
        self._scorer = scorer
        self._features = FrontierFeatures(config.max_candidates)
        self._listens = config.promise == Promise()

    def _scores(self, loop: ExplorationLoop) -> Float32Array:
        """Scores of the candidates, shape (N,); all -inf at the end."""
        decision = self._scorer.decide(self._features.observe(loop))
        if self._listens and loop.may_stop and decision.done > 0.0:
            return np.full(len(loop.candidates), -np.inf, np.float32)
        return decision.scores


def fingerprint_of(weights: Mapping[str, Float32Array]) -> str:
    """The first 12 hex digits of the SHA-256 of weights in the order of their names."""
    digest = hashlib.sha256()
    for name in sorted(weights):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(weights[name], "<f4").tobytes())
    return digest.hexdigest()[:12]


def write_policy(path: Path, weights: Mapping[str, Float32Array], about: Mapping[str, Any]) -> None:
    """Write the weights of a frontier policy.

    Args:
        path: The ``.safetensors`` file.
        weights: By the names of the network's parameters.
        about: How they were trained.
    """
    write_weights(path, weights, {"space": _SPACE, "network": _NETWORK, "about": dict(about)})


def write_weights(
    path: Path, weights: Mapping[str, Float32Array], description: Mapping[str, Any]
) -> None:
    """Write weights as safetensors with their description in the header, and that as JSON next to them."""
    tensors = {name: np.ascontiguousarray(value, dtype="<f4") for name, value in weights.items()}
    header = json.dumps(description, sort_keys=True)
    write_bytes(path, save(tensors, {"slamgym": header}))
    readable = json.dumps(description, indent=2, sort_keys=True)
    write_text(path.with_suffix(".json"), readable + "\n")


def write_mean(paths: Sequence[Path], path: Path) -> None:
    """Write the mean of the weights in some files that :func:`write_weights` wrote, described as those of the last."""
    states = [load_file(one) for one in paths]
    weights = {name: np.mean([state[name] for state in states], axis=0) for name in states[0]}
    description = read_json(paths[-1].with_suffix(".json"))
    if len(paths) > 1:
        description["about"]["mean_of"] = [one.stem for one in paths]
    write_weights(path, weights, description)


def read_policy(path: Path | str) -> tuple[dict[str, Float32Array], dict[str, Any]]:
    """The weights of a frontier policy, which must fit this version's observations, and how they were trained.

    Raises:
        InputFileError: If the file is missing, damaged, or made for another observation space.
    """
    return read_weights(Path(path), "frontier policy", (_SPACE, _NETWORK), weight_shapes())


def read_weights(
    path: Path,
    what: str,
    description: tuple[Mapping[str, Any], Mapping[str, Any]],
    shapes: Mapping[str, tuple[int, ...]],
) -> tuple[dict[str, Float32Array], dict[str, Any]]:
    """The tensors in a safetensors file, which must be single precision and finite, and how they were trained.

    Args:
        path: The file.
        what: Kind of its policy.
        description: Of the observations and of the network that this version has.
        shapes: Of the tensors, by name.

    Raises:
        InputFileError: If the file is missing or damaged, its header is none of a policy, or it was trained on other
            observations or another network.
    """
    check_origin(path)
    require_file(path, WEIGHT_BYTES)
    try:
        with safe_open(path, framework="np") as file:
            weights: dict[str, Float32Array] = {}
            for name in file.keys():  # noqa: SIM118 - not a mapping
                if file.get_slice(name).get_dtype() != "F32":
                    raise InputFileError(
                        path, f"is damaged at {name!r}; download or train it again"
                    )
                weights[name] = file.get_tensor(name)
            metadata = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise InputFileError(
            path, f"is no whole safetensors file ({error}); download or train it again"
        ) from None
    for name, array in weights.items():
        if not np.isfinite(array).all():
            raise InputFileError(
                path, f"has weights that are no numbers at {name!r}; train it again"
            )
    try:
        found = load_json(metadata["slamgym"])
        theirs = (found["space"], found["network"])
        about = found["about"]
    except (KeyError, TypeError, ValueError):
        raise InputFileError(path, f"holds no {what}; slamgym agents train writes one") from None
    for one, mine in zip(theirs, description, strict=True):
        _refuse_other_space(path, one, mine)
    for name, shape in shapes.items():
        if name not in weights:
            raise InputFileError(
                path, f"{name} is missing where its configuration asks for {shape}"
            )
        found_shape = weights[name].shape
        if found_shape != shape:
            raise InputFileError(
                path, f"{name} has shape {found_shape} where its configuration asks for {shape}"
            )
    return weights, about


def _refuse_other_space(path: Path, theirs: Any, ours: Mapping[str, Any]) -> None:
    """Refuse weights that were trained on other observations or in another network than this version's.

    Raises:
        InputFileError: Naming the first difference.
    """
    if not isinstance(theirs, dict):
        raise InputFileError(path, "doesn't say which observations it was trained on")
    for name, mine in ours.items():
        their = theirs.get(name)
        if their == mine:
            continue
        if isinstance(mine, list):
            count = len(their) if isinstance(their, list) else "no"
            their = f"{count} features"
            mine = f"{len(mine)}, or others"
        if name == "env":
            raise InputFileError(
                path,
                f"was trained on another observation space (env {their}, this version has {mine}); "
                "rl:FILE takes frontier policies, wheels:FILE drivers of the wheels",
            )
        raise InputFileError(
            path,
            f"was trained on another observation space ({name} {their}, this version has {mine}); "
            "train again or use the version it was made with",
        )


def weight_shapes() -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights of a frontier policy."""
    norms = {f"{name}.{part}": (WIDTH,) for name in NORMS for part in ("weight", "bias")}
    return {**linear_shapes(LINEAR_LAYERS), **norms}


def linear_shapes(layers: Mapping[str, tuple[int, int]]) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights and biases of layers, given by their inputs and outputs."""
    shapes: dict[str, tuple[int, ...]] = {}
    for name, (inputs, outputs) in layers.items():
        shapes[f"{name}.weight"] = (outputs, inputs)
        shapes[f"{name}.bias"] = (outputs,)
    return shapes

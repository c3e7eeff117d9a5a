"""The explorer ``wheels``: a trained network drives, nothing chooses a frontier or follows a path; without torch."""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamgym.agents.explorer import BatchedExplorer, Pilot
from slamgym.agents.pretrained_policy import (
    fingerprint_of,
    linear_shapes,
    read_weights,
    write_weights,
)
from slamgym.agents.rl.train_config import CROP_SIDE, HOLD, LAYER_UNITS, WHEELS_NETWORK
from slamgym.core.errors import ConfigError
from slamgym.core.portable import product
from slamgym.core.types import Float32Array, Observation, OccupancyGrid, Pose2D, Twist2D
from slamgym.envs.compact import BLOCKS, SCAN_SECTORS, CompactObserver, MapTiles, compact_size
from slamgym.envs.completion import SMALLEST_FRONTIER, CompletionDetector
from slamgym.envs.far_look import FAR_SIZE, SECTORS
from slamgym.planning.context import ExplorerContext
from slamgym.planning.costmap import crop_known
from slamgym.planning.path_follower import PathFollower

WHEELS = Path(__file__).parent / "pretrained" / "wheels_policy.safetensors"
"""The policy that comes with the package."""

WHEELS_LAYERS = ("first", "second", "action")
"""Names of the network's layers."""
CLIP = 5.0
"""Normalised observations are cut off here."""
_EPSILON = 1e-8
"""Added to the variances of the observations."""
_CONFIRMATIONS = 5
"""It's done when so many maps published one after another say so: a stray reading closes a door until the next look."""
_SPACE = {
    "env": "slamgym/Explore",
    "preset": "compact_far",
    "ways": "of the body",
    "blocks": BLOCKS,
    "ranges": SCAN_SECTORS,
    "sectors": SECTORS,
}
"""Observations that the weights take in."""


@dataclass(frozen=True)
class WheelsPolicy:
    """Weights of the network."""

    weights: Mapping[str, Float32Array]
    """By the names of :func:`wheels_shapes`."""
    about: Mapping[str, Any]
    """How they were trained."""

    def act(self, observation: Float32Array) -> Float32Array:
        """Shares of the largest speed and turning rate, shape (..., 2) in [-1, 1].

        Args:
            observation: Of the preset ``compact_far``, shape (..., n).
        """
        variance = self.weights["variance"]
        centred = observation - self.weights["mean"]
        scaled = np.clip(centred / np.sqrt(variance + np.float32(_EPSILON)), -CLIP, CLIP)
        hidden = scaled.reshape(-1, scaled.shape[-1])
        hidden = np.maximum(self._linear("first", hidden), 0.0)
        hidden = np.maximum(self._linear("second", hidden), 0.0)
        action = np.clip(self._linear("action", hidden), -1.0, 1.0)
        return action.reshape(*observation.shape[:-1], 2)

    def _linear(self, name: str, values: Float32Array) -> Float32Array:
        return product(values, self._layers[name]) + self.weights[f"{name}.bias"]

    @functools.cached_property
    def _layers(self) -> dict[str, Float32Array]:
        """The weights of each layer as :func:`product` takes them, (inputs, outputs)."""
        return {
            name: np.ascontiguousarray(self.weights[f"{name}.weight"].T) for name in WHEELS_LAYERS
        }


def wheels_shapes() -> dict[str, tuple[int, ...]]:
    """Names and shapes of the weights."""
    size = compact_size(SCAN_SECTORS) + FAR_SIZE
    first, second = LAYER_UNITS
    layers = zip(WHEELS_LAYERS, ((size, first), (first, second), (second, 2)), strict=True)
    return {"mean": (size,), "variance": (size,), **linear_shapes(dict(layers))}


def write_wheels(path: Path, policy: WheelsPolicy) -> None:
    """Write weights with their description, also as JSON next to them."""
    description = {"space": _SPACE, "network": WHEELS_NETWORK, "about": dict(policy.about)}
    write_weights(path, policy.weights, description)


def read_wheels(path: Path | str = WHEELS) -> WheelsPolicy:
    """Read weights and check that they fit this version's observations.

    Raises:
        InputFileError: If the file is missing, damaged, or made for another observation.
    """
    description = (_SPACE, WHEELS_NETWORK)
    weights, about = read_weights(
        Path(path), "policy that drives the wheels", description, wheels_shapes()
    )
    return WheelsPolicy(weights, about)


class WheelsPilot(Pilot):
    """Looks, asks the network, and holds its answer for some control steps.

    Args:
        context: What the environment says about the robot and its map.
        policy: The network.
        avoids: True to drive round what the scan shows in the way, whatever the network says.
    """

    def __init__(self, context: ExplorerContext, policy: WheelsPolicy, avoids: bool = True) -> None:
        self._context = context
        self._policy = policy
        laser = context.geometry
        limits = (context.max_linear, context.max_angular, laser.range_max)
        self._observer = CompactObserver(laser.num_beams, limits, CROP_SIDE, context.robot_radius)
        self._detector = CompletionDetector(context.robot_radius, SMALLEST_FRONTIER)
        self._follower = PathFollower(context) if avoids else None
        self._confirmed = 0  # by so many maps
        self._steps = 0
        self._command = Twist2D(0.0, 0.0)
        self._publication = round(context.map_update_interval / context.control_step) or 1

    def act(self, observation: Observation) -> Twist2D:
        """Velocity for the next control step; see :meth:`Pilot.act`."""
        context = self._context
        cells = observation["map"][0]
        pose = Pose2D(*observation["pose"].tolist())
        if self._steps % self._publication == 0:
            grid = crop_known(OccupancyGrid(cells, context.frame), pose)
            is_explored = self._detector.is_explored(grid, pose)
            self._confirmed = self._confirmed + 1 if is_explored else 0
            self.finished = self._confirmed >= _CONFIRMATIONS
            self._shown = MapTiles.of_grid(cells, context.frame)
            self._observer.refresh(self._shown)
        if self._steps % HOLD == 0:
            velocity = Twist2D(*observation["velocity"].tolist())
            seen = self._observer.observe(self._shown, observation["scan"], pose, velocity)
            linear, angular = self._policy.act(seen).tolist()
            self._command = Twist2D(linear * context.max_linear, angular * context.max_angular)
            self.decisions += 1
        self._steps += 1
        if self._follower is None:
            return self._command
        return self._follower.avoid(self._command, observation["scan"])


class WheelsExplorer(BatchedExplorer):
    """Drives the wheels by a trained network, from observations ``compact_far`` of the published map.

    Args:
        context: What the environment says about the robot and its map.
        policy: Weights, as ``slamgym agents train wheels`` writes them; by default those of the package.
        avoids: See :class:`WheelsPilot`.

    Raises:
        ConfigError: If the scanner has too few beams.
        InputFileError: If the weights are missing, damaged, or made for other observations.
    """

    def __init__(
        self, context: ExplorerContext, policy: Path | str = WHEELS, avoids: bool = True
    ) -> None:
        if context.geometry.num_beams < SCAN_SECTORS:
            raise ConfigError(
                f"the explorer wheels needs a scanner of {SCAN_SECTORS} beams or more, not {context.geometry.num_beams}"
            )
        found = read_wheels(policy)
        super().__init__(
            context, fingerprint_of(found.weights), lambda _: WheelsPilot(context, found, avoids)
        )

"""PPO for options that last a varying number of seconds.

Between decisions that lie tau seconds apart the discount is ``discount ** tau`` (Sutton, Precup and Singh,
"Between MDPs and semi-MDPs", Artificial Intelligence 1999, section 3). Stable-Baselines3's PPO has one gamma
per step, so the rollout buffer here estimates the advantages (Schulman et al. 2016, eq. 16) with a discount of
its own for each step, and a callback gives it the durations, which the environment reports in
``info["duration"]``.
"""

from typing import Any

import numpy as np
import torch
from sb3_contrib.common.maskable.buffers import MaskableDictRolloutBuffer
from stable_baselines3.common.buffers import DictRolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback

from slamgym.core.types import Float32Array


class _Discounts:
    """The part that both buffers share; ``gamma`` of the buffer is the discount per second."""

    buffer_size: int
    n_envs: int
    gamma: float
    gae_lambda: float
    rewards: Float32Array
    values: Float32Array
    episode_starts: Float32Array
    advantages: Float32Array
    returns: Float32Array
    durations: Float32Array
    pos: int

    def reset(self) -> None:
        """Forget the rollout."""
        super().reset()  # type: ignore[misc]
        self.durations = np.zeros((self.buffer_size, self.n_envs), np.float32)

    def compute_returns_and_advantage(self, last_values: Any, dones: Any) -> None:
        """Generalised advantage estimation with a discount per step.

        Args:
            last_values: Values of the observations after the last step, tensor of shape (n_envs,) or (n_envs, 1).
            dones: Whether the last step ended the episodes, shape (n_envs,).
        """
        following = last_values.clone().cpu().numpy().flatten()
        discounts = self.gamma**self.durations
        advantage = np.zeros(self.n_envs, np.float32)
        goes_on = 1.0 - dones.astype(np.float32)
        for step in reversed(range(self.buffer_size)):
            error = self.rewards[step] + discounts[step] * following * goes_on - self.values[step]
            advantage = error + discounts[step] * self.gae_lambda * goes_on * advantage
            self.advantages[step] = advantage
            following, goes_on = self.values[step], 1.0 - self.episode_starts[step]
        self.returns = self.advantages + self.values


class SemiMarkovBuffer(_Discounts, DictRolloutBuffer):
    """For ``PPO``."""


class MaskableSemiMarkovBuffer(_Discounts, MaskableDictRolloutBuffer):
    """For ``MaskablePPO``."""


class SemiMarkovDiscounting(BaseCallback):
    """Reports to the buffer how long each step took, and discounts the value at a time limit by it too."""

    def _on_step(self) -> bool:
        buffer: Any = self.model.rollout_buffer
        infos: list[dict[str, Any]] = self.locals["infos"]
        buffer.durations[buffer.pos] = [info["duration"] for info in infos]
        for index, info in enumerate(infos):
            if self.locals["dones"][index] and info.get("TimeLimit.truncated", False):
                # The algorithm would count this value by its gamma per step; so it is added here instead.
                info["TimeLimit.truncated"] = False
                observation, _ = self.model.policy.obs_to_tensor(info["terminal_observation"])
                with torch.no_grad():
                    value = float(self.model.policy.predict_values(observation)[0])
                self.locals["rewards"][index] += buffer.gamma ** info["duration"] * value
        return True

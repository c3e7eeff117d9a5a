"""Rollouts of whole explorations, several of each building, for on-policy algorithms of Stable-Baselines3.

What a choice is worth drowns in what the building is worth: choices make 6 % of a return's variance, plan, start and
noise the rest. So every rollout is a batch of whole explorations, several copies of each building, start and noise,
that begin together and end as they end; who has ended waits for the others. What the other copies still got from the
moment when as much floor was left is an exploration's baseline (leave-one-out, Kool et al. 2019), used as a potential,
which leaves the best policy as it is (Ng, Harada and Russell 1999); the critic learns the rest, and may see the truth.
"""

from collections.abc import Generator
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.type_aliases import DictRolloutBufferSamples

from slamgym.core.types import BoolArray, FloatArray, Observation
from slamgym.envs.coverage import CELL
from slamgym.envs.explore_frontiers_env import ExploreFrontiersEnv

TRUTH = ("is_running", "share_left", "area_left", "floor_area", "time", "missing")
"""What training alone knows: whether the exploration is still running, the share and the area of the floor that is left
[20 m2], the floor [100 m2], time [600 s], and tenths of the floor missing below the promise."""
_RUNNING = TRUTH.index("is_running")
_LEFT = TRUTH.index("share_left")
_TIME = TRUTH.index("time")
_TIME_SCALE = 600.0


class WholeEpisodes(gym.Wrapper[Observation, Any, Observation, Any]):
    """An environment that waits at the end of an episode until it is told to begin the next; observes the truth, too.

    Args:
        env: The environment.
        most_decisions: An exploration that isn't over after so many ends there, as at its time limit; both are charged
            as any end.
    """

    def __init__(self, env: ExploreFrontiersEnv, most_decisions: int) -> None:
        super().__init__(env)
        self._env = env
        self._most = most_decisions
        known = env.observation_space
        assert isinstance(known, spaces.Dict)
        truth = spaces.Box(-np.inf, np.inf, (len(TRUTH),), np.float32)
        self.observation_space = spaces.Dict({**known.spaces, "truth": truth})
        self._idle = {
            name: np.zeros(space.shape or (), np.float32)
            for name, space in self.observation_space.spaces.items()
        }
        self._seed: int | None = None
        self._is_running = False

    def begin(self, seed: int) -> None:
        """Let the next reset begin an episode."""
        self._seed = seed

    def reset(self, **_: Any) -> tuple[Observation, dict[str, Any]]:
        """Begin the episode that was announced, or wait."""
        self._is_running = self._seed is not None
        if not self._is_running:
            return self._idle, {}
        observation, info = self._env.reset(seed=self._seed)
        self._seed = None
        self._decisions = 0
        self._floor_area = float(np.count_nonzero(self._env.inner.coverage.floor)) * CELL**2
        return self._with_truth(observation, info), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Decide, or wait."""
        if not self._is_running:
            return self._idle, 0.0, False, False, {}
        observation, reward, terminated, truncated, info = self._env.step(action)
        self._decisions += 1
        if not terminated and (truncated or self._decisions >= self._most):
            reward += self._env.inner.conclude()[0]
            terminated = True
        if terminated:
            self._is_running = False
            info["map_error"] = self._env.inner.map_error()
        return self._with_truth(observation, info), reward, terminated, False, info

    def _with_truth(self, observation: Observation, info: dict[str, Any]) -> Observation:
        left = 1.0 - info["coverage"]
        area = self._floor_area
        missing = max(0.0, left - (1.0 - self._env.config.reward.promised))
        time = self._env.loop.time / _TIME_SCALE
        truth = [1.0, left, left * area / 20.0, area / 100.0, time, 10.0 * missing]
        return {**observation, "truth": np.array(truth, np.float32)}


class WholeEpisodeBuffer(DictRolloutBuffer):
    """A rollout of whole episodes, with a baseline from the copies of each.

    Args:
        *args: As for the base class.
        copies: So many neighbouring environments have the same episode.
        discount: Of the return, per second.
        **kwargs: As for the base class.

    Attributes:
        shares: Of the returns' variance that is left after the baseline of the copies, and after the critic.
    """

    values: Any
    generator_ready: bool

    def __init__(self, *args: Any, copies: int = 1, discount: float = 1.0, **kwargs: Any) -> None:
        self.copies = copies
        self.discount = discount
        self.shares = (1.0, 1.0)
        super().__init__(*args, **kwargs)

    @property
    def running(self) -> BoolArray:
        """Which rows hold a decision, shape (steps, environments)."""
        return np.asarray(self.observations["truth"][..., _RUNNING] > 0.5)

    def compute_returns_and_advantage(self, last_values: Any, dones: Any) -> None:  # noqa: ARG002 - all episodes have ended
        """Advantages of the decisions (generalised advantage estimation on what the copies don't explain)."""
        running = self.running
        times = self.observations["truth"][..., _TIME] * _TIME_SCALE
        follows = np.zeros_like(running)
        follows[:-1] = running[1:] & running[:-1]
        weights = np.zeros(running.shape)
        weights[:-1] = np.where(follows[:-1], self.discount ** (times[1:] - times[:-1]), 0.0)
        rewards = self.rewards.astype(np.float64)
        returns = np.zeros(running.shape)
        after = np.zeros(self.n_envs)
        for t in range(len(running) - 1, -1, -1):
            after = np.where(running[t], rewards[t] + weights[t] * after, 0.0)
            returns[t] = after
        baseline = copies_baseline(
            returns, self.observations["truth"][..., _LEFT], running, self.copies
        )
        values = self.values * running
        total = baseline + values
        advantage = np.zeros(self.n_envs)
        for t in range(len(running) - 1, -1, -1):
            following = total[t + 1] if t + 1 < len(running) else 0.0
            error = rewards[t] + weights[t] * following - total[t]
            advantage = np.where(running[t], error + weights[t] * self.gae_lambda * advantage, 0.0)
            self.advantages[t] = advantage
        self.values = values.astype(np.float32)
        self.returns = self.advantages + self.values
        spread = max(float(returns[running].var()), 1e-9)
        self.shares = (
            float((returns - baseline)[running].var()) / spread,
            float((returns - total)[running].var()) / spread,
        )

    def get(self, batch_size: int | None = None) -> Generator[DictRolloutBufferSamples, None, None]:
        """The decisions, in random minibatches; who waits decides nothing."""
        assert self.full
        if not self.generator_ready:
            rows = np.flatnonzero(self.swap_and_flatten(self.running))
            for name, table in self.observations.items():
                self.observations[name] = self.swap_and_flatten(table)[rows]
            for name in ("actions", "values", "log_probs", "advantages", "returns"):
                setattr(self, name, self.swap_and_flatten(getattr(self, name))[rows])
            self.generator_ready = True
        indices = np.random.permutation(len(self.actions))  # noqa: NPY002 - as in the base class, which SB3 seeds
        size = batch_size or len(indices)
        for first in range(0, len(indices), size):
            yield self._get_samples(indices[first : first + size])


def copies_baseline(
    returns: FloatArray, left: FloatArray, running: BoolArray, copies: int
) -> FloatArray:
    """What the other copies still got from the first moment when no more floor was left, in the mean.

    Args:
        returns: Still to come, shape (steps, environments).
        left: Share of the floor left; never grows within an episode.
        running: Which decisions there were.
        copies: So many neighbouring environments are copies of one another.

    Returns:
        Shape (steps, environments); 0 with one copy.
    """
    baseline = np.zeros(returns.shape)
    if copies < 2:
        return baseline
    lengths = running.sum(axis=0)
    for first in range(0, returns.shape[1], copies):
        group = [i for i in range(first, first + copies) if lengths[i]]
        for i in group:
            own = slice(0, lengths[i])
            others = [j for j in group if j != i]
            for j in others:
                at = np.searchsorted(-left[: lengths[j], j], -left[own, i] - 1e-9)
                at = np.minimum(at, lengths[j] - 1)
                baseline[own, i] += returns[at, j] / len(others)
    return baseline


class WholeEpisodeRollouts(OnPolicyAlgorithm):
    """Mixin for an on-policy algorithm: each rollout begins with fresh episodes, each building in so many copies."""

    num_timesteps: int

    def collect_rollouts(
        self, env: Any, callback: Any, rollout_buffer: Any, n_rollout_steps: int
    ) -> bool:
        """Collect whole episodes; see the base class. Only decisions count as steps."""
        before = self.num_timesteps
        copies = rollout_buffer.copies
        seeds = np.random.randint(2**31 - 1, size=env.num_envs // copies)  # noqa: NPY002 - SB3's generator, which a run seeds
        for group, seed in enumerate(seeds.tolist()):
            env.env_method("begin", seed, indices=range(copies * group, copies * (group + 1)))
        self._last_obs = env.reset()
        self._last_episode_starts = np.ones(env.num_envs, dtype=bool)
        goes_on = super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        self.num_timesteps = before + int(rollout_buffer.running.sum())
        after_copies, after_critic = rollout_buffer.shares
        self.logger.record("rollout/variance_after_copies", after_copies)
        self.logger.record("rollout/variance_after_critic", after_critic)
        return goes_on

"""The batched environment with Stable-Baselines3's interface."""

import time
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from slamgym.core.errors import ConfigError
from slamgym.core.types import FloatArray, Twist2D
from slamgym.envs.batch.env import BatchExploreEnv
from slamgym.envs.explore_env import explorer_context
from slamgym.envs.simulation import Actions
from slamgym.planning.path_follower import PathFollower


class BatchVecEnv(VecEnv):
    """A batch of environments as a ``VecEnv``.

    ``infos`` hold what Stable-Baselines3 looks at, at the end of an episode: ``terminal_observation``,
    ``TimeLimit.truncated`` and, as its ``Monitor`` does, ``episode``, with coverage and contacts besides.

    Args:
        env: The batch; it must begin the next episode in the same step.
        hold: An action holds for so many control steps; what is rewarded in them is added up.
        seconds: Shortest and longest episode [s], each cut off at a time drawn evenly between, the first ones earlier
            so that they don't end together; None leaves that to the environment.
        seed: Random seed of that draw and, until :meth:`seed` is called, of the environments.
        avoids: True to drive round what scans show in the way, whatever the actions say.
    """

    def __init__(
        self,
        env: BatchExploreEnv,
        hold: int = 1,
        seconds: tuple[float, float] | None = None,
        seed: int = 0,
        avoids: bool = False,
    ) -> None:
        if env.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            raise ConfigError("Stable-Baselines3 needs autoreset_mode='same_step'")
        self.env = env  # which the base class asks for its render mode
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self._hold = hold
        self._seconds = seconds
        self._follower = PathFollower(explorer_context(env.config)) if avoids else None
        self._rng = np.random.default_rng(seed)
        self.seed(seed)
        self._actions: Any = None
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, dtype=np.int64)
        self._limits = np.full(env.num_envs, np.inf)
        self._begun = time.time()

    def reset(self) -> Any:
        """Begin episodes in all environments."""
        observations, self.reset_infos = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        limits = self._draw_limits(self.num_envs)
        self._limits = limits * self._rng.uniform(0.1, 1.0, self.num_envs)
        return observations

    def step_async(self, actions: Any) -> None:
        """Take the actions."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, FloatArray, Any, list[dict[str, Any]]]:
        """Step; see :class:`stable_baselines3.common.vec_env.VecEnv`."""
        rewards = np.zeros(self.num_envs)
        over = np.zeros(self.num_envs, dtype=np.bool_)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for _ in range(self._hold):
            observations, reward, terminations, truncations, all_infos = self.env.step(self._safe())
            rewards += np.where(over, 0.0, reward)  # what follows an end belongs to no episode
            ended = terminations | truncations
            for i in np.flatnonzero(ended & ~over).tolist():
                is_cut = bool(truncations[i] and not terminations[i])
                infos[i] = _last(all_infos["final_obs"][i], all_infos["final_info"], i, is_cut)
            over |= ended
        self._returns += rewards
        self._lengths += 1
        seconds = self._lengths * self._hold * self.env.config.control_step
        late = (seconds >= self._limits) & ~over
        if late.any():
            for i in np.flatnonzero(late).tolist():
                infos[i] = _last(_row(observations, i), all_infos, i, is_cut=True)
            observations, _ = self.env.reset(options={"reset_mask": late})
        over |= late
        self._close_episodes(np.flatnonzero(over), infos)
        return observations, rewards.astype(np.float32), over, infos

    def _safe(self) -> Any:
        """The actions, or what drives round what the scans show."""
        follower = self._follower
        if follower is None:
            return self._actions
        to_action = follower.context.to_action
        commands = Actions(self.env.config).to_commands(self._actions)
        actions = []
        for command, ranges in zip(commands.tolist(), self.env.ranges, strict=True):
            actions.append(to_action(follower.avoid(Twist2D(*command), ranges)))
        return np.array(actions)

    def _close_episodes(self, ids: Any, infos: list[dict[str, Any]]) -> None:
        """Add what the monitor of Stable-Baselines3 would, and begin to count again."""
        for i in ids.tolist():
            infos[i]["episode"] = {
                "r": float(self._returns[i]),
                "l": int(self._lengths[i]),
                "t": round(time.time() - self._begun, 3),
                "coverage": infos[i].pop("coverage"),
                "collisions": infos[i].pop("collisions"),
            }
        self._returns[ids] = 0.0
        self._lengths[ids] = 0
        self._limits[ids] = self._draw_limits(len(ids))

    def _draw_limits(self, count: int) -> FloatArray:
        if self._seconds is None:
            return np.full(count, np.inf)
        return self._rng.uniform(*self._seconds, count)

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the batch, once for each environment."""
        return [getattr(self.env, attr_name)] * self._count(indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002 - the interface
        """Refused: environments of a batch are alike."""
        raise ConfigError(f"environments of a batch are alike; {attr_name} of one can't be set")

    def env_method(self, method_name: str, *args: Any, **kwargs: Any) -> list[Any]:  # noqa: ARG002 - the interface
        """Refused: environments of a batch have no separate methods."""
        raise ConfigError(
            f"environments of a batch have no methods of their own, so no {method_name}"
        )

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """True for the monitor of Stable-Baselines3, whose work this class does."""
        return [wrapper_class.__name__ == "Monitor"] * self._count(indices)

    def _count(self, indices: Any) -> int:
        return len(list(self._get_indices(indices)))


def _row(observations: Any, index: int) -> Any:
    if isinstance(observations, dict):
        return {name: value[index] for name, value in observations.items()}
    return observations[index]


def _last(observation: Any, infos: Any, index: int, is_cut: bool) -> dict[str, Any]:
    """Info at the end of an episode."""
    return {
        "terminal_observation": observation,
        "TimeLimit.truncated": is_cut,
        "coverage": float(infos["coverage"][index]),
        "collisions": int(infos["collisions"][index]),
    }

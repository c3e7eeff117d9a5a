"""The chain of wrappers that CleanRL's ppo_continuous_action.py puts round an environment."""

import gymnasium as gym
import numpy as np

import slamgym  # noqa: F401 - registers the environments


def test_flattened_and_normalised_observations_step_in_a_vector():
    def make():
        env = gym.make("slamgym/Explore-v4", localization="ground_truth")
        env = gym.wrappers.FlattenObservation(env)
        env = gym.wrappers.RecordEpisodeStatistics(env)
        env = gym.wrappers.ClipAction(env)
        env = gym.wrappers.NormalizeObservation(env)
        env = gym.wrappers.TransformObservation(
            env, lambda obs: np.clip(obs, -10, 10), env.observation_space
        )
        env = gym.wrappers.NormalizeReward(env, gamma=0.99)
        return gym.wrappers.TransformReward(env, lambda reward: np.clip(reward, -10, 10))

    envs = gym.vector.SyncVectorEnv([make, make])
    assert isinstance(envs.single_action_space, gym.spaces.Box)
    observations, _ = envs.reset(seed=1)
    size = 84 * 84 + 180 + 3 + 2 + 1
    for _ in range(5):
        assert observations.shape == (2, size)
        assert np.isfinite(observations).all()
        observations, rewards, terminated, truncated, _ = envs.step(
            3.0 * envs.action_space.sample()
        )
        assert np.isfinite(rewards).all()
        assert not (terminated | truncated).any()
    envs.close()

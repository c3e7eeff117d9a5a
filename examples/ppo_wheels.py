"""Proximal policy optimisation on the batched environment, in one file, as CleanRL's ``ppo_continuous_action.py`` is.

A robot learns to drive through homes so that it sees as much of them as it can. ``slamgym agents train wheels``
does the same with checkpoints, validation and weights to keep; this file is there to be read and changed.

    python examples/ppo_wheels.py --total-timesteps 300000
    python examples/ppo_wheels.py --recurrent    # with a memory, for what the crop of the map no longer shows
"""

import time
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
import tyro
from gymnasium.vector import AutoresetMode
from torch import nn
from torch.distributions import Normal

import slamgym


@dataclass
class Args:
    """What decides a run."""

    plans: str = "bundled"
    """floor plans: bundled, procedural, an archive, ..."""
    seed: int = 1
    """seed of everything random"""
    total_timesteps: int = 300_000
    """control steps of all environments together"""
    num_envs: int = 32
    """environments in the batch"""
    num_steps: int = 128
    """steps of each environment between two updates"""
    recurrent: bool = False
    """put a gated recurrent unit behind the first layer"""
    episode_seconds: float = 90.0
    """robot time of an episode"""
    learning_rate: float = 5e-4
    """of Adam; falls linearly to 0"""
    gamma: float = 0.997
    """discount per control step of 0.2 s"""
    gae_lambda: float = 0.95
    """lambda of the advantages"""
    num_minibatches: int = 8
    """minibatches of a rollout: whole sequences of some environments"""
    update_epochs: int = 4
    """passes over a rollout"""
    clip_coef: float = 0.2
    """how far the probability of an action may change"""
    ent_coef: float = 0.001
    """weight of the entropy"""
    vf_coef: float = 0.5
    """weight of the value's error"""
    max_grad_norm: float = 0.5
    """largest norm of a gradient"""


def layer_init(layer: nn.Linear, std: float = np.sqrt(2), bias: float = 0.0) -> nn.Linear:
    nn.init.orthogonal_(layer.weight, std)
    nn.init.constant_(layer.bias, bias)
    return layer


class Agent(nn.Module):
    """Action and value from a layer that they share, and from a memory if it has one."""

    def __init__(self, envs: gym.vector.VectorEnv, recurrent: bool) -> None:
        super().__init__()
        size, actions = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
        self.shared = nn.Sequential(layer_init(nn.Linear(size, 128)), nn.ReLU())
        self.memory = nn.GRU(128, 128) if recurrent else None
        self.critic, self.actor = (
            nn.Sequential(
                layer_init(nn.Linear(128, 64)), nn.ReLU(), layer_init(nn.Linear(64, units), std)
            )
            for units, std in ((1, 1.0), (actions, 0.01))
        )
        self.actor[-1].bias.data[0] = 0.9  # a robot that drives sees more than one that stands
        self.logstd = nn.Parameter(torch.full((1, actions), np.log(0.5)))

    def remember(
        self, x: torch.Tensor, state: torch.Tensor, fresh: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Hidden units (T, B, 128) of observations (T, B, size), and the memory (1, B, 128) after them.

        An episode begins, with an empty memory, where ``fresh`` (T, B) is 1.
        """
        hidden = self.shared(x)
        if self.memory is None:
            return hidden, state
        steps = []
        for units, begins in zip(hidden, fresh, strict=True):
            out, state = self.memory(units[None], state * (1.0 - begins)[None, :, None])
            steps.append(out)
        return torch.cat(steps), state

    def get_action_and_value(
        self, hidden: torch.Tensor, action: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, ...]:
        """Action, its log-probability, entropy and value, from hidden units, shape (T, B, 128)."""
        mean = self.actor(hidden)
        probs = Normal(mean, self.logstd.exp().expand_as(mean))
        if action is None:
            action = probs.sample()
        value = self.critic(hidden).squeeze(-1)
        return action, probs.log_prob(action).sum(-1), probs.entropy().sum(-1), value


def main(args: Args) -> list[float]:
    """Train; returns the mean coverage of the episodes that ended in each update."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    envs = gym.make_vec(
        "slamgym/Explore-v4",
        num_envs=args.num_envs,
        plans=args.plans,
        localization="ground_truth",
        observation={"preset": "compact", "map": "global"},
        reward={
            "coverage_gain": 0.0,
            "floor_gain": 0.1,
            "time": 0.0,
            "collision": 0.02,
            "completion": 0.0,
        },
        time_limit=args.episode_seconds,
        terminate_when_explored=False,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    agent = Agent(envs, args.recurrent)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)

    shape = (args.num_steps, args.num_envs)
    obs = torch.zeros((*shape, *envs.single_observation_space.shape))
    actions = torch.zeros((*shape, *envs.single_action_space.shape))
    logprobs, rewards, dones, values, fresh = (torch.zeros(shape) for _ in range(5))
    batch_size = args.num_steps * args.num_envs
    num_iterations = max(1, args.total_timesteps // batch_size)
    begin, coverages = time.process_time(), []
    next_obs = torch.as_tensor(envs.reset(seed=args.seed)[0])
    state, begins = torch.zeros(1, args.num_envs, 128), torch.ones(args.num_envs)

    for iteration in range(num_iterations):
        optimizer.param_groups[0]["lr"] = (1.0 - iteration / num_iterations) * args.learning_rate
        ended, first_state = [], state
        for step in range(args.num_steps):
            obs[step], fresh[step] = next_obs, begins
            with torch.no_grad():
                hidden, state = agent.remember(next_obs[None], state, begins[None])
                actions[step], logprobs[step], _, values[step] = agent.get_action_and_value(hidden)
            seen, reward, terminations, truncations, infos = envs.step(
                actions[step].clip(-1, 1).numpy()
            )
            rewards[step] = torch.as_tensor(reward)
            dones[step] = begins = torch.as_tensor(terminations | truncations).float()
            if "final_info" in infos:
                ended += infos["final_info"]["coverage"][truncations | terminations].tolist()
            for i in np.flatnonzero(truncations & ~terminations).tolist():
                # The time was up: what would have followed counts.
                last = torch.as_tensor(infos["final_obs"][i])[None, None]
                with torch.no_grad():
                    hidden, _ = agent.remember(last, state[:, i : i + 1], torch.zeros(1, 1))
                    rewards[step, i] += args.gamma * agent.get_action_and_value(hidden)[3][0, 0]
            next_obs = torch.as_tensor(seen)

        with torch.no_grad():
            hidden, _ = agent.remember(next_obs[None], state, begins[None])
            next_value = agent.get_action_and_value(hidden)[3][0]
            advantages, lastgaelam = torch.zeros_like(rewards), torch.zeros(args.num_envs)
            for t in reversed(range(args.num_steps)):
                nextvalues = values[t + 1] if t + 1 < args.num_steps else next_value
                delta = rewards[t] + args.gamma * nextvalues * (1.0 - dones[t]) - values[t]
                lastgaelam = delta + args.gamma * args.gae_lambda * (1.0 - dones[t]) * lastgaelam
                advantages[t] = lastgaelam
            returns = advantages + values

        for _ in range(args.update_epochs):
            for picked in torch.randperm(args.num_envs).chunk(args.num_minibatches):
                hidden, _ = agent.remember(obs[:, picked], first_state[:, picked], fresh[:, picked])
                _, newlogprob, entropy, newvalue = agent.get_action_and_value(
                    hidden, actions[:, picked]
                )
                ratio = (newlogprob - logprobs[:, picked]).exp()
                b_advantages = advantages[:, picked]
                b_advantages = (b_advantages - b_advantages.mean()) / (b_advantages.std() + 1e-8)
                clipped = ratio.clamp(1 - args.clip_coef, 1 + args.clip_coef)
                pg_loss = -torch.min(b_advantages * ratio, b_advantages * clipped).mean()
                v_loss = 0.5 * (newvalue - returns[:, picked]).square().mean()
                loss = pg_loss - args.ent_coef * entropy.mean() + args.vf_coef * v_loss
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
                optimizer.step()

        if ended:
            coverages.append(float(np.mean(ended)))
            print(
                f"step {(iteration + 1) * batch_size}: coverage after {args.episode_seconds:.0f} s "
                f"{coverages[-1]:.2f}, {time.process_time() - begin:.0f} CPU s"
            )
    envs.close()
    print(f"slamgym {slamgym.__version__}: {num_iterations * batch_size} steps")
    return coverages


if __name__ == "__main__":
    main(tyro.cli(Args))

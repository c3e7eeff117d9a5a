"""Discounting by seconds for learners that know only one gamma per step."""

from typing import Any

import gymnasium as gym

from slamgym.core.errors import ConfigError


class DiscountByTermination(gym.Wrapper[Any, Any, Any, Any]):
    """Makes a constant gamma exact for steps of varying duration.

    A step of tau seconds is worth ``per_second ** tau`` of what follows. The learner takes ``gamma`` off for
    every step; the rest, ``per_second ** tau / gamma``, is the probability that the episode goes on, and the
    episode is ended otherwise: a discount is a probability of stopping (Puterman, "Markov Decision Processes",
    1994, section 5.3). What a learner expects is then the semi-Markov value, at the price of more variance.
    The wrapped environment should have the same discount, so that rewards within a step count alike.

    Args:
        env: ``slamgym/ExploreFrontiers-v0``.
        per_second: Discount per second.
        gamma: That of the learner. Steps shorter than ``log(gamma) / log(per_second)`` seconds count as so
            long, for no probability is above 1.
    """

    def __init__(self, env: gym.Env[Any, Any], per_second: float = 0.998, gamma: float = 0.996) -> None:
        super().__init__(env)
        if not 0.0 < per_second < 1.0 or not 0.0 < gamma < 1.0:
            raise ConfigError(f"per_second and gamma must lie in (0, 1), not {per_second} and {gamma}")
        self._per_second, self.gamma = per_second, gamma

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step, and perhaps end the episode; ``info["discounted_away"]`` says whether it was that."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        goes_on = min(1.0, self._per_second ** info["duration"] / self.gamma)
        stops = not (terminated or truncated) and bool(self.np_random.random() >= goes_on)
        info = {**info, "discounted_away": stops}
        return observation, float(reward), terminated or stops, truncated, info

    def action_masks(self) -> Any:
        """What sb3-contrib asks for."""
        return self.env.get_wrapper_attr("action_masks")()

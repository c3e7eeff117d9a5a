"""Reward presets for ``slamgym agents shape``: all of them, with their weights, in this one file.

Every preset is a :class:`~slamgym.envs.rewards.RewardConfig`, and two have a term of their own besides. Most pay for
time; the others are in a hurry by the learner's discount alone.
A term of your own needs no preset: ``slamgym agents shape --term my_module:my_function`` adds it to one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.envs import RewardConfig, RewardFunction
from slamgym.envs.rewards import StepRecord

BASE = "time"
"""What the others add to, and are compared with."""

_NOTHING = RewardConfig(coverage_gain=0.0, time=0.0, collision=0.0, completion=0.0)


@dataclass(frozen=True)
class RewardPreset:
    """A reward and what it is for."""

    reward: RewardConfig
    about: str
    needs_filter: bool = False
    """Whether the reward only makes sense with a particle filter: with true poses there is no error to pay."""
    terms: Mapping[str, tuple[float, RewardFunction]] = field(default_factory=dict)
    """Further terms: name to (weight, function)."""
    exposure_prior: float = 0.0
    """What the scores of its policies begin with beside what they begin with anyway; see
    :class:`~slamgym.agents.scoring.NetworkConfig`."""

    @property
    def in_batch(self) -> bool:
        """Whether a batch of environments can pay it, on which the wheels learn."""
        reward = self.reward
        asks_more = reward.map_error or reward.information_gain or reward.pose_uncertainty or reward.exposure
        return not (asks_more or self.terms)


def error_of_new_map(step: StepRecord) -> float:
    """Minus the new map's area times the error of the pose that it is drawn from [m3].

    A wall is drawn as wrongly as the robot is wrong about where it stands, so over an exploration this adds up
    to about the map's mean error times its area, but each part is due when the decision that causes it is paid:
    the growth of the mean error (:func:`~slamgym.envs.rewards.map_error_cost`) is spread over all later steps.
    """
    return -step.pose_error * _new_area(step)


def uncertainty_of_new_map(step: StepRecord) -> float:
    """The same by what a robot can know: the filter's position uncertainty instead of the true error [m3].

    Nothing is due in known space, where the robot may be as unsure as it likes; exploring is worth more once
    a loop is closed than before (active SLAM; Stachniss, Grisetti and Burgard 2005).
    """
    return -step.position_sigma * _new_area(step)


def _new_area(step: StepRecord) -> float:
    # The map of another particle may know less than that of the last step's best one.
    return max(0.0, step.known_area - step.previous_known_area)


REWARD_PRESETS: dict[str, RewardPreset] = {
    "coverage_only": RewardPreset(replace(_NOTHING, coverage_gain=2.0), "floor truly seen, and nothing else"),
    "floor": RewardPreset(
        replace(_NOTHING, floor_gain=1.0, collision=1.0),
        "square metres truly seen, less contacts",
    ),
    "information_gain": RewardPreset(
        replace(_NOTHING, information_gain=0.02), "growth of the robot's own map: needs no truth"
    ),
    "path_cost": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, path_length=0.08), "coverage, less the path driven"
    ),
    "time": RewardPreset(replace(_NOTHING, coverage_gain=2.0, time=0.02), "coverage, less the time taken"),
    "collision": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02, collision=0.1), "as time, less contacts"
    ),
    "map_error": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02, map_error=40.0),
        "as time, less the growth of the map's true error (Daher et al. assess maps by it)",
        needs_filter=True,
    ),
    "pose_uncertainty": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02, pose_uncertainty=0.2),
        "as time, less the filter's position uncertainty over time: active SLAM, pays for closing loops "
        "(Stachniss, Grisetti and Burgard 2005)",
        needs_filter=True,
    ),
    "coastal": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02, exposure=0.03),
        "as time, less the distance from walls of the paths chosen: coastal navigation (Roy, Burgard, Fox and "
        "Thrun 1999); begins with a preference for paths along walls, which the charge alone is too weak to teach",
        exposure_prior=-8.0,
    ),
    "careful_mapping": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02),
        "as time, less the true pose error under which each new part of the map is drawn",
        needs_filter=True,
        terms={"error_of_new_map": (0.4, error_of_new_map)},
    ),
    "certain_mapping": RewardPreset(
        replace(_NOTHING, coverage_gain=2.0, time=0.02),
        "the same with the filter's position uncertainty in the error's place: needs no truth but coverage",
        needs_filter=True,
        terms={"uncertainty_of_new_map": (0.8, uncertainty_of_new_map)},
    ),
    "potential": RewardPreset(
        replace(_NOTHING, time=0.02, shaping=2.0),
        "time, and potential-based coverage (Ng, Harada and Russell 1999): the optimal policies are those of "
        "time alone",
    ),
    "completion": RewardPreset(
        replace(_NOTHING, time=0.02, completion=5.0), "time, and a bonus at the end: sparse"
    ),
}
"""The presets by name."""


def reward_preset(name: str) -> RewardPreset:
    """A preset by its name.

    Raises:
        ConfigError: If there is none; the error suggests the nearest.
    """
    if name not in REWARD_PRESETS:
        raise ConfigError(f"no reward preset {name!r}; {suggest(name, REWARD_PRESETS)}")
    return REWARD_PRESETS[name]

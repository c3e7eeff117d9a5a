"""Rewards: small functions of one transition, summed by weights.

Each term is signed so that a positive weight asks for what most users want: gains are positive, costs
negative. They compute without branches, so that a record may hold arrays, a row for each of many environments.
Coverage, clearance and map error come from the truth, which is legitimate for a training signal and never
reaches an observation.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import field, fields
from functools import partial
from typing import Any

import numpy as np

from slamgym.core.config import Settings, Share, suggest
from slamgym.core.errors import ConfigError
from slamgym.envs.records import StepRecord

RewardFunction = Callable[[StepRecord], float]
RewardTerms = Mapping[str, tuple[float, RewardFunction]]
"""Terms of the user's own: name to (weight, function)."""


MOST_MISSING = 5.0
"""Hundredths of the floor; :func:`missing_cost` counts no more. A home with a room missing is not explored, with two
neither."""
WISHED_CLEARANCE = 0.2
"""Room that :func:`clearance_cost` wants [m]: what an 0.8 m door leaves on either side of a TurtleBot3."""


def coverage_gain(step: StepRecord) -> float:
    """Share of the reachable floor seen for the first time; sums to the final coverage."""
    return step.coverage - step.previous_coverage


def floor_gain(step: StepRecord) -> float:
    """Floor seen for the first time [m2]: :func:`coverage_gain` without the size of the building."""
    return (step.coverage - step.previous_coverage) * step.floor_area


def time_cost(step: StepRecord) -> float:
    """Minus the time spent [s]."""
    return -step.duration


def path_cost(step: StepRecord) -> float:
    """Minus the distance driven [m]."""
    return -step.distance


def collision_cost(step: StepRecord) -> float:
    """Minus one for a step with contact."""
    return 0.0 - step.contact


def map_error_cost(step: StepRecord) -> float:
    """Minus the growth of the map's error [m]; sums to minus the final error."""
    return step.previous_map_error - step.map_error


def information_gain(step: StepRecord) -> float:
    """Bits of the map's entropy that the step has taken away; sums to what the map knows in the end."""
    return step.previous_entropy - step.entropy


def clearance_cost(step: StepRecord) -> float:
    """Minus what is missing of :data:`WISHED_CLEARANCE` [m]."""
    return np.minimum(0.0, step.clearance - WISHED_CLEARANCE)


def turning_cost(step: StepRecord) -> float:
    """Minus the angle turned [rad]: smooth paths turn little."""
    return -np.abs(step.turning)


def revisit_cost(step: StepRecord) -> float:
    """Minus one for each time that the robot had come to this place before."""
    return 0.0 - step.revisits


def uncertainty_cost(step: StepRecord) -> float:
    """Minus the believed standard deviation of the position [m]."""
    variance: Any = step.covariance[..., 0, 0] + step.covariance[..., 1, 1]
    return 0.0 - variance**0.5


def completion_bonus(step: StepRecord) -> float:
    """One when the exploration is complete."""
    return 0.0 + step.terminated


def potential_shaping(step: StepRecord, discount: float) -> float:
    """Potential-based shaping F = discount * Phi(s') - Phi(s) (Ng, Harada and Russell, ICML 1999, eq. 2).

    The potential is coverage - 1, minus what is left to see. It is 0 in the terminal state, as the theorem
    demands (after a complete exploration nothing is left), so the shaped task has the same optimal policies.

    Args:
        step: The transition.
        discount: Gamma of the learner.
    """
    after = (step.coverage - 1.0) * (1.0 - step.terminated)
    return discount * after - (step.previous_coverage - 1.0)


def missing_cost(step: StepRecord, promised: float) -> float:
    """Minus the hundredths of the floor that are missing below a promised share when the exploration ends.

    Args:
        step: The transition.
        promised: The share.
    """
    missing = 100.0 * (promised - step.coverage)
    return 0.0 - np.clip(missing, 0.0, MOST_MISSING) * step.terminated


def weight_of(term: RewardFunction, default: float) -> Any:
    """The field of a term's weight."""
    return field(default=default, metadata={"term": term})


class RewardConfig(Settings, section="reward"):
    """Weights of the reward terms; a term of weight 0 is neither computed nor reported."""

    coverage_gain: float = weight_of(coverage_gain, 10.0)
    """Per share of the reachable floor (:func:`coverage_gain`); a whole exploration earns this much."""

    floor_gain: float = weight_of(floor_gain, 0.0)
    """Per m2 of floor (:func:`floor_gain`)."""

    time: float = weight_of(time_cost, 0.01)
    """Per second (:func:`time_cost`); 420 s cost 4.2, less than full coverage earns."""

    path_length: float = weight_of(path_cost, 0.0)
    """Per metre driven (:func:`path_cost`)."""

    collision: float = weight_of(collision_cost, 0.1)
    """Per step with contact (:func:`collision_cost`)."""

    map_error: float = weight_of(map_error_cost, 0.0)
    """Per metre of mean map error (:func:`map_error_cost`)."""

    information_gain: float = weight_of(information_gain, 0.0)
    """Per bit of the map's entropy (:func:`information_gain`); 1 m2 has 400 cells of 0.05 m."""

    clearance: float = weight_of(clearance_cost, 0.0)
    """Per missing metre and step (:func:`clearance_cost`)."""

    turning: float = weight_of(turning_cost, 0.0)
    """Per radian (:func:`turning_cost`)."""

    revisits: float = weight_of(revisit_cost, 0.0)
    """Per earlier visit of a place (:func:`revisit_cost`)."""

    uncertainty: float = weight_of(uncertainty_cost, 0.0)
    """Per metre of the position's deviation and step (:func:`uncertainty_cost`)."""

    completion: float = weight_of(completion_bonus, 1.0)
    """Once, at the end (:func:`completion_bonus`)."""

    missing: float = 0.0
    """Per hundredth of the floor missing below :attr:`promised` at the end (:func:`missing_cost`)."""

    promised: Share = 0.98
    """Share of the floor that is to be seen."""

    shaping: float = 0.0
    """Weight of the potential (:func:`potential_shaping`)."""

    discount: Share = 0.995
    """Gamma in the shaping; must be the learner's."""


FRONTIER_REWARD = RewardConfig(
    coverage_gain=0.0, time=0.02, collision=0.01, completion=0.0, shaping=2.0, discount=1.0
)
"""For ``ExploreFrontiersEnv``: a fiftieth per second, and potential-based coverage so that progress shows at once."""

FUNCTIONS: dict[str, RewardFunction] = {
    weight.name: weight.metadata["term"]
    for weight in fields(RewardConfig)
    if "term" in weight.metadata
}
"""The terms by the name of their weight; shaping comes with its discount."""


class Reward:
    """The sum of weighted terms.

    Args:
        config: Weights of the terms above.
        extra: Terms of the user's own.

    Attributes:
        terms: Weight and function of the active terms by the name that ``info["reward_terms"]`` shows.
        may_measure: True if a term may read what a step did to the map.

    Raises:
        ConfigError: If terms of the user's own are no mapping, or one has a name that is taken or isn't (number,
            function); in a call, if it fails or gives no finite number.
    """

    def __init__(self, config: RewardConfig, extra: RewardTerms | None = None) -> None:
        functions = dict(FUNCTIONS)
        functions["shaping"] = partial(potential_shaping, discount=config.discount)
        functions["missing"] = partial(missing_cost, promised=config.promised)
        self.terms: dict[str, tuple[float, RewardFunction]] = {}
        for name, function in functions.items():
            weight = getattr(config, name)
            if weight != 0.0:
                self.terms[name] = weight, function
        own_terms: Any = extra or {}
        if not isinstance(own_terms, Mapping):
            raise ConfigError(
                f"reward_terms must be a mapping of names to (weight, function), not {extra!r}"
            )
        for name, entry in own_terms.items():
            weight, function = _own_term(name, entry, functions)
            self.terms[name] = weight, partial(_own_value, name, function)
        of_map = {"map_error", "information_gain"}
        self.may_measure = bool(extra) or not of_map.isdisjoint(self.terms)

    def __call__(self, step: StepRecord) -> tuple[Any, dict[str, Any]]:
        """The reward of a transition, and what each term contributed to it; of many transitions an array for each."""
        total: Any = 0.0 * step.coverage
        contributions = {}
        for name, (weight, term) in self.terms.items():
            contributions[name] = weight * term(step)
            total = total + contributions[name]
        return total, contributions


def _own_term(
    name: str, entry: tuple[float, RewardFunction], taken: Mapping[str, RewardFunction]
) -> tuple[float, RewardFunction]:
    """Weight and function of a term of the user's own, which may not have a name that is taken."""
    if name in taken:
        raise ConfigError(
            f"reward_terms: {name!r} is a term already; set its weight by reward.{name}"
        )
    try:
        weight, function = entry
        weight = float(weight)
    except (TypeError, ValueError):
        raise ConfigError(
            f"reward_terms[{name!r}] must be (weight, function), not {entry!r}"
        ) from None
    if callable(function) and math.isfinite(weight):
        return weight, function
    if isinstance(function, str):
        raise ConfigError(
            f"reward_terms[{name!r}] must be (weight, function), not {entry!r}; {suggest(function, taken)}"
        )
    raise ConfigError(
        f"reward_terms[{name!r}] must be (weight, function), not {entry!r}; give a function of a StepRecord"
    )


def _own_value(name: str, function: RewardFunction, step: StepRecord) -> Any:
    """What a term of the user's own gives for a transition, or for each of many."""
    if np.ndim(step.coverage):
        robots = range(len(step.coverage))  # type: ignore[arg-type]  # of many
        return np.array([_own_value(name, function, step.of_robot(index)) for index in robots])
    try:
        value = math.fsum([function(step)])  # which refuses text, as float() doesn't
    except Exception as error:
        raise ConfigError(
            f"reward term {name!r} failed after {step.time:.1f} s: {type(error).__name__}: {error}"
        ) from error
    if not math.isfinite(value):
        raise ConfigError(
            f"reward term {name!r} gave {value} after {step.time:.1f} s, not a finite number"
        )
    return value

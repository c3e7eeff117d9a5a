"""Coefficients of the two phases from measured straight lines and turns in place.

A run gives the true motion and the believed one. The systematic coefficient of a robot is the slope of its
error; the random coefficient is the scatter about that slope per square root of the distance, as independent
slips add up. What is written is what :class:`slamgym.parametric.config.TwoPhaseConfig` draws from: the spread
of the systematic coefficients over robots and the random coefficients.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from slamgym.core.config import from_dict
from slamgym.core.documents import json_text, parse_json
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import read_bytes, write_text
from slamgym.core.limits import DOCUMENT_BYTES
from slamgym.core.types import FloatArray
from slamgym.parametric.config import TwoPhaseConfig


@dataclass(frozen=True)
class Runs:
    """Repeated calibration runs of several robots; one row per robot, one column per repetition."""

    distance: FloatArray  # (R, N) true length of each straight line [m]
    distance_error: FloatArray  # (R, N) believed minus true length [m]
    drift: FloatArray  # (R, N) believed minus true heading after the line [rad]
    turn: FloatArray  # (R, N) true angle of each turn in place, signed [rad]
    turn_error: FloatArray  # (R, N) believed minus true angle [rad]


def fit_phases(runs: Runs) -> TwoPhaseConfig:
    """Fit the coefficients.

    Raises:
        ConfigError: If there are fewer than two robots or two repetitions.
    """
    if min(runs.distance.shape) < 2:
        raise ConfigError("a calibration needs at least 2 robots with 2 repetitions each")
    k_l, s_l = _slope_and_scatter(runs.distance, runs.distance_error)
    k_lt, s_lt = _slope_and_scatter(runs.distance, runs.drift)
    k_t, s_t = _slope_and_scatter(runs.turn, runs.turn_error)
    return TwoPhaseConfig(k_l=k_l, k_lt=k_lt, k_t=k_t, s_l=s_l, s_lt=s_lt, s_t=s_t)


def _slope_and_scatter(amount: FloatArray, error: FloatArray) -> tuple[float, float]:
    """Spread over robots of error / amount, and the random error per square root of the amount.

    With an error k a + s sqrt|a| n the efficient estimate of k is sum(sign(a) e) / sum|a|; its own variance
    s^2 / sum|a| is taken off the spread.
    """
    total = np.abs(amount).sum(axis=1)
    slope = (np.sign(amount) * error).sum(axis=1) / total  # (R,)
    residual = (error - slope[:, None] * amount) / np.sqrt(np.abs(amount))
    random = float((residual**2).sum() / (residual.size - len(slope)))
    spread = float(np.mean(slope**2) - random * np.mean(1.0 / total))
    return float(np.sqrt(max(spread, 0.0))), float(np.sqrt(random))


def write_calibration(path: Path | str, coefficients: TwoPhaseConfig, about: dict[str, object]) -> None:
    """Write the coefficients as JSON, with what they were measured on.

    Raises:
        InputFileError: If the file can't be written.
    """
    write_text(path, json_text({"two_phase": asdict(coefficients), "about": about}))


def read_calibration(path: Path | str) -> TwoPhaseConfig:
    """Read measured coefficients.

    Raises:
        InputFileError: If the file can't be read or has not the six coefficients.
    """
    document = parse_json(read_bytes(path, DOCUMENT_BYTES), path)
    values = document.get("two_phase") if isinstance(document, dict) else None
    if not isinstance(values, dict):
        raise InputFileError(path, 'has no section "two_phase"; write it with slamgym calibrate-odometry')
    try:
        coefficients = from_dict(TwoPhaseConfig, values)
    except ConfigError as error:
        raise InputFileError(path, str(error)) from error
    missing = sorted(asdict(coefficients).keys() - values.keys())
    if missing:
        raise InputFileError(path, f"has no coefficient {missing[0]!r}")
    return coefficients

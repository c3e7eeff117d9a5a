"""The two phases' coefficients are recovered from runs made with them."""

import json

import numpy as np
import pytest

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.parametric.calibration import Runs, fit_phases, read_calibration, write_calibration
from slamgym.parametric.config import TwoPhaseConfig


def simulated_runs(config: TwoPhaseConfig, robots: int, repeats: int) -> Runs:
    rng = np.random.default_rng(0)
    k = rng.standard_normal((3, robots, 1)) * np.array([config.k_l, config.k_lt, config.k_t])[:, None, None]
    way = rng.uniform(1.0, 3.0, (robots, repeats))
    turn = rng.choice([-1.0, 1.0], (robots, repeats)) * rng.uniform(1.0, 6.0, (robots, repeats))
    n = rng.standard_normal((3, robots, repeats))
    return Runs(
        distance=way,
        distance_error=k[0] * way + config.s_l * np.sqrt(way) * n[0],
        drift=k[1] * way + config.s_lt * np.sqrt(way) * n[1],
        turn=turn,
        turn_error=k[2] * turn + config.s_t * np.sqrt(np.abs(turn)) * n[2],
    )


def test_coefficients_are_recovered() -> None:
    config = TwoPhaseConfig()
    fitted = fit_phases(simulated_runs(config, robots=400, repeats=10))
    # A spread over 400 robots is known to 1/sqrt(800) = 3.5 %; three standard errors.
    for name in ("k_l", "k_lt", "k_t"):
        assert getattr(fitted, name) == pytest.approx(getattr(config, name), rel=0.11)
    # The random part rests on 400 x 9 residuals.
    for name in ("s_l", "s_lt", "s_t"):
        assert getattr(fitted, name) == pytest.approx(getattr(config, name), rel=0.05)


def test_noise_alone_is_not_taken_for_a_systematic_error() -> None:
    config = TwoPhaseConfig(k_l=0.0, k_lt=0.0, k_t=0.0)
    fitted = fit_phases(simulated_runs(config, robots=400, repeats=10))
    # Without the correction the slopes' own noise s/sqrt(20 m) would show.
    assert fitted.k_lt < 0.4 * config.s_lt / np.sqrt(20.0)


def test_coefficients_survive_the_file(tmp_path) -> None:
    fitted = fit_phases(simulated_runs(TwoPhaseConfig(), robots=5, repeats=4))
    path = tmp_path / "calibration.json"
    write_calibration(path, fitted, {"odometry": "medium"})
    assert read_calibration(path) == fitted


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not valid JSON"),
        ("{}", 'no section "two_phase"'),
        (json.dumps({"two_phase": {"k_x": 1.0}}), "unknown setting 'k_x'"),
        (json.dumps({"two_phase": {"k_l": -1.0}}), "k_l must be at least 0, not -1.0"),
        (json.dumps({"two_phase": {"k_l": "a"}}), "k_l must be of type float, not 'a'"),
        (json.dumps({"two_phase": {"k_l": 0.1}}), "has no coefficient 'k_lt'"),
    ],
)
def test_bad_calibration_files_are_refused_by_name(tmp_path, text, message) -> None:
    path = tmp_path / "calibration.json"
    path.write_text(text)
    with pytest.raises(InputFileError, match=message):
        read_calibration(path)


def test_too_few_runs_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least 2 robots"):
        fit_phases(simulated_runs(TwoPhaseConfig(), robots=1, repeats=4))

"""Calibration of the two phases on the simulated robot."""

import json
import math

import numpy as np
import pytest

from slamgym.commands.calibrate_odometry import measure_odometry
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError
from slamgym.parametric.calibration import fit_phases, read_calibration
from slamgym.sim import OdometryConfig, RobotConfig, odometry_level


def main(argv):
    return TABLE.run("slamgym", ["calibrate-odometry", *map(str, argv)])


ROBOT = RobotConfig()


def calibrate(config: OdometryConfig, robots: int = 25):
    return fit_phases(measure_odometry(config, ROBOT, robots, 6, np.random.default_rng(0)))


def test_ideal_odometry_has_no_error() -> None:
    fitted = calibrate(odometry_level("ideal"), robots=3)
    assert max(vars(fitted).values()) < 1e-6


def test_the_simulators_own_magnitudes_are_found() -> None:
    config = odometry_level("low")
    fitted = calibrate(config)
    # Random parts: 25 robots x 5 free residuals, 6 % standard error, and the speed ramps' odd steps.
    assert fitted.s_lt == pytest.approx(config.slip_drift, rel=0.2)
    # While turning, the wheels' own drift adds nothing: there is no distance.
    assert fitted.s_t == pytest.approx(config.slip_turn, rel=0.2)
    # Spreads over 25 robots: 14 % standard error.
    assert fitted.k_l == pytest.approx(config.scale_std, rel=0.45)
    assert fitted.k_t == pytest.approx(math.hypot(config.wheelbase_ratio_std, config.scale_std), rel=0.45)
    assert fitted.k_lt == pytest.approx(config.diameter_ratio_std / ROBOT.wheel_separation, rel=0.45)


def test_the_command_writes_what_deform_reads(tmp_path, capsys) -> None:
    out = tmp_path / "calibration.json"
    assert main(["-o", str(out), "--robots", "3", "--repeats", "3", "--odometry", "high"]) == 0
    assert "3 robots x 3 lines" in capsys.readouterr().out
    document = json.loads(out.read_text())
    assert document["about"]["odometry"] == "high"
    assert read_calibration(out).s_l == document["two_phase"]["s_l"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robots", "1"], "--robots must be at least 2, not 1"),
        (["--repeats", "1"], "--repeats must be at least 2, not 1"),
    ],
)
def test_bad_arguments_write_nothing(tmp_path, arguments, message) -> None:
    out = tmp_path / "calibration.json"
    with pytest.raises(ConfigError, match=message):
        main(["-o", str(out), *arguments])
    assert not out.exists()

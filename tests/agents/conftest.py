"""Fixtures for the tests of evaluations: explorations made up."""

import dataclasses

import pytest

from slamgym.agents.evaluation.coverage_curve import COVERAGE_LEVELS
from slamgym.agents.evaluation.trial import Trial, level_name


def _trial(explorer="ours", plan="p0", seconds=100.0, reached=0.99, seed=1, **changes):
    """An exploration with even progress until ``seconds``, when it ends with ``reached`` seen."""
    names = {level_name(level): level for level in COVERAGE_LEVELS}
    time_to = {
        k: level / reached * seconds if level <= reached else None for k, level in names.items()
    }
    return dataclasses.replace(
        Trial(
            explorer=explorer,
            plan=plan,
            seed=seed,
            settings="x",
            area=50.0,
            rooms=4,
            time_limit=700.0,
            finished=True,
            time=seconds,
            path=0.2 * seconds,
            coverage=reached,
            time_to=time_to,
            path_to={k: None if v is None else 0.2 * v for k, v in time_to.items()},
            mean_coverage=0.7,
            collisions=0,
            map_error=0.02,
            ate=0.1,
            decisions=10,
            decision_cpu=0.004,
            cpu=2.0,
            curve={
                "time": [0.0, seconds],
                "path": [0.0, 0.2 * seconds],
                "coverage": [0.0, reached],
            },
        ),
        **changes,
    )


@pytest.fixture
def make_trial():
    """Make an exploration up; see ``_trial``."""
    return _trial

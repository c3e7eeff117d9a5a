import math

import pytest

from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError
from slamgym.sim import ClutterConfig, RobotConfig


@pytest.mark.parametrize(
    ("name", "value"), [("wheel_separation", 0.0), ("max_linear", math.inf), ("radius", math.nan)]
)
def test_senseless_measures_are_refused_by_name(name, value):
    with pytest.raises(ConfigError, match=name):
        RobotConfig(**{name: value})


@pytest.mark.parametrize("values", [{"furniture": 4.0}, {"people": -1}, {"changes": -0.1}])
def test_senseless_clutter_is_refused(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        ClutterConfig(**values)


@pytest.mark.parametrize(
    "config", [RobotConfig(radius=0.2), ClutterConfig(furniture=0.5, people=2)]
)
def test_settings_survive_json(config):
    assert from_dict(type(config), to_dict(config)) == config

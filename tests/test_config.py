from dataclasses import dataclass, field

import pytest

from slamgym.config import config_hash, from_dict, to_dict
from slamgym.errors import ConfigError
from slamgym.types import Pose2D


@dataclass(frozen=True)
class Inner:
    range_max: float = 3.5
    mount: Pose2D = Pose2D(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Outer:
    particles: int = 30
    inner: Inner = field(default_factory=Inner)
    optional: Inner | None = None
    levels: tuple[float, ...] = (1.0, 2.0)


def test_round_trip_keeps_nested_values():
    config = Outer(particles=8, inner=Inner(4.0, Pose2D(1.0, 2.0, 3.0)), optional=Inner(), levels=(3.0,))
    assert from_dict(Outer, to_dict(config)) == config


def test_missing_names_keep_their_defaults():
    assert from_dict(Outer, {"particles": 5}) == Outer(particles=5)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"particels": 5}, ["unknown setting 'particels'", "did you mean 'particles'?"]),
        ({"inner": {"rangemax": 1.0}}, ["inner", "did you mean 'range_max'?"]),
        ({"qqqq": 1}, ["known: inner, levels, optional, particles"]),
    ],
)
def test_unknown_names_are_refused_with_a_suggestion(values, words):
    with pytest.raises(ConfigError) as caught:
        from_dict(Outer, values)
    assert all(word in str(caught.value) for word in words)


def test_the_hash_tells_settings_apart_and_is_stable():
    assert config_hash(Outer()) == config_hash(Outer())
    assert config_hash(Outer()) != config_hash(Outer(particles=31))

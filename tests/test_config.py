from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from slamgym.core.config import config_hash, from_dict, replace_setting, setting_names, to_dict
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D


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
    parts: Mapping[str, tuple[Inner, ...]] = field(default_factory=dict)


def test_round_trip_keeps_nested_values():
    config = Outer(particles=8, inner=Inner(4.0, Pose2D(1.0, 2.0, 3.0)), optional=Inner(), levels=(3.0,))
    assert from_dict(Outer, to_dict(config)) == config
    nested = Outer(parts={"a": (Inner(1.0), Inner(2.0, Pose2D(1.0, 0.0, 0.0))), "b": ()})
    assert from_dict(Outer, to_dict(nested)) == nested


def test_missing_names_keep_their_defaults():
    assert from_dict(Outer, {"particles": 5}) == Outer(particles=5)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"particels": 5}, ["unknown setting 'particels'", "did you mean 'particles'?"]),
        ({"inner": {"rangemax": 1.0}}, ["inner", "did you mean 'range_max'?"]),
        ({"qqqq": 1}, ["known: inner, levels, optional, particles, parts"]),
    ],
)
def test_unknown_names_are_refused_with_a_suggestion(values, words):
    with pytest.raises(ConfigError) as caught:
        from_dict(Outer, values)
    assert all(word in str(caught.value) for word in words)


def test_the_hash_tells_settings_apart_and_is_stable():
    assert config_hash(Outer()) == config_hash(Outer())
    assert config_hash(Outer()) != config_hash(Outer(particles=31))


def test_a_setting_is_replaced_by_its_dotted_name():
    changed = replace_setting(Outer(), "inner.range_max", 5)
    assert changed == Outer(inner=Inner(range_max=5))
    assert replace_setting(Outer(), "levels", [4.0]).levels == (4.0,)
    assert replace_setting(Outer(), "optional", None).optional is None
    assert setting_names(Outer()) == [
        "particles",
        "inner.range_max",
        "inner.mount",
        "optional",
        "levels",
        "parts",
    ]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("inner.rangemax", 1.0, "unknown setting 'inner.rangemax'; did you mean 'inner.range_max'"),
        ("particels", 1, "did you mean 'particles'"),
        ("particles.x", 1, "unknown setting 'particles.x'"),
        ("particles", 1.5, "particles can't be 1.5; it must be of type int"),
        ("particles", True, "can't be True"),
        ("levels", ["a"], "levels can't be"),
        ("inner", 3, "inner can't be 3; it must be of type Inner"),
    ],
)
def test_a_wrong_replacement_is_refused_by_name(name, value, words):
    with pytest.raises(ConfigError, match=words):
        replace_setting(Outer(), name, value)

import dataclasses
import math
import pickle
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any, Literal

import hypothesis.strategies as st
import numpy as np
import pytest
import tyro
from hypothesis import given

from slamgym.core.config import (
    LARGEST,
    Arguments,
    Count,
    CountOrZero,
    NonNegative,
    Positive,
    PositiveShare,
    Settings,
    Share,
    ShareBelowOne,
    Within,
    changed_settings,
    config_hash,
    from_dict,
    replace_setting,
    setting_names,
    to_dict,
)
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D


class Inner(Settings, section="inner"):
    """The inner part."""

    range_max: Positive = 3.5
    """Largest range."""
    mount: Pose2D = Pose2D(0.0, 0.0, 0.0)


class Outer(Settings):
    """The whole."""

    particles: Count = 30
    """Their number."""
    inner: Inner = field(default_factory=Inner)
    optional: Inner | None = None
    levels: tuple[float, ...] = (1.0, 2.0)
    parts: Mapping[str, tuple[Inner, ...]] = field(default_factory=dict)


def test_round_trip_keeps_nested_values():
    config = Outer(
        particles=8, inner=Inner(4.0, Pose2D(1.0, 2.0, 3.0)), optional=Inner(), levels=(3.0,)
    )
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


def test_the_hash_distinguishes_settings_and_is_stable():
    assert config_hash(Outer()) == config_hash(Outer())
    assert config_hash(Outer()) != config_hash(Outer(particles=31))


def test_of_changed_settings_only_the_first_are_named():
    before = {"seed": 1, "slam": {"particles": 30, "rate": 5.0}, "plans": ["home"] * 99, "time": 3}
    assert changed_settings(before, dict(before)) == ""
    nested = {**before, "slam": {"particles": 40, "rate": 5.0}}
    assert changed_settings(before, nested) == "slam.particles was 30, now 40"
    several = {"seed": 2, "slam": {}, "plans": ["school"], "time": 4}
    named = changed_settings(before, several)
    assert named.startswith("plans was ['home', 'home', ")
    assert named.endswith("; slam.particles was 30, now None; and 2 more")
    assert len(named) < 200


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
        ("particles", 1.5, "^particles must be of type int, not 1.5"),
        ("particles", True, "of type int, not True"),
        ("levels", ["a"], r"^levels\[0\] must be of type float, not 'a'"),
        ("inner", 3, "^inner must be of type Inner, not 3"),
        ("inner.range_max", -1.0, r"^inner\.range_max must be above 0, not -1.0"),
    ],
)
def test_a_wrong_replacement_is_refused_by_name(name, value, words):
    with pytest.raises(ConfigError, match=words):
        replace_setting(Outer(), name, value)


class Everything(Settings, section="every"):
    """A setting of each kind."""

    positive: Positive = 1.0
    non_negative: NonNegative = 0.0
    share: Share = 1.0
    positive_share: PositiveShare = 1.0
    share_below_one: ShareBelowOne = 0.0
    count: Count = 1
    count_or_zero: CountOrZero = 0
    number: float = 0.0
    below: Annotated[float, Within(lt=5.0)] = 0.0
    at_most: Annotated[float, Within(le=5.0)] = 0.0
    between: Annotated[float, Within(gt=-1.0, le=2.0)] = 0.0
    side: Annotated[int, Within(ge=8, le=64, power_of_two=True)] = 8
    unlimited: Annotated[float, Within(gt=0.0, infinite=True)] = math.inf
    optional: Positive | None = None
    minutes: Literal["auto"] | Positive = "auto"
    mode: Literal["rbpf", "pose_graph"] = "rbpf"
    pair: tuple[float, Positive] = (0.0, 1.0)
    scales: tuple[Positive, ...] = ()
    bounded: Annotated[tuple[float, ...], Within(ge=0.0)] = ()
    mount: Pose2D = Pose2D(0.0, 0.0, 0.0)
    anything: Any = None
    weights: Mapping[str, Positive] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("positive", 0.0, "every.positive must be above 0, not 0.0"),
        ("non_negative", -1, "every.non_negative must be at least 0, not -1"),
        ("share", 1.5, "every.share must be in [0, 1], not 1.5"),
        ("positive_share", 0.0, "every.positive_share must be in (0, 1], not 0.0"),
        ("share_below_one", 1.0, "every.share_below_one must be in [0, 1), not 1.0"),
        ("count", 0, "every.count must be at least 1, not 0"),
        ("count", 2.0, "every.count must be of type int, not 2.0"),
        ("count_or_zero", -1, "every.count_or_zero must be at least 0, not -1"),
        ("number", math.inf, "every.number must be finite, not inf"),
        ("number", "3", "every.number must be of type float, not '3'"),
        ("below", 5.0, "every.below must be below 5, not 5.0"),
        ("at_most", 5.5, "every.at_most must be at most 5, not 5.5"),
        ("between", -1.0, "every.between must be in (-1, 2], not -1.0"),
        ("side", 48, "every.side must be a power of two in [8, 64], not 48"),
        ("side", 128, "every.side must be a power of two in [8, 64], not 128"),
        ("unlimited", -math.inf, "every.unlimited must be above 0, not -inf"),
        ("optional", -2.0, "every.optional must be above 0 or None, not -2.0"),
        ("minutes", 0, "every.minutes must be 'auto' or above 0, not 0"),
        (
            "minutes",
            "auot",
            "every.minutes must be 'auto' or of type float, not 'auot'; did you mean 'auto'?",
        ),
        (
            "mode",
            "rbfp",
            "every.mode must be 'rbpf' or 'pose_graph', not 'rbfp'; did you mean 'rbpf'?",
        ),
        ("mode", 3, "every.mode must be 'rbpf' or 'pose_graph', not 3"),
        ("pair", (0.0, 0.0), "every.pair[1] must be above 0, not 0.0"),
        ("pair", (0.0,), "every.pair must be 2 values, not (0.0,)"),
        ("scales", (1.0, -1.0), "every.scales[1] must be above 0, not -1.0"),
        ("scales", [1.0], "every.scales must be of type tuple, not [1.0]"),
        ("bounded", (0.0, -1.0), "every.bounded[1] must be at least 0, not -1.0"),
        ("mount", Pose2D(0.0, 0.0, math.nan), "every.mount.theta must be finite, not nan"),
        ("weights", {"a": 0.0}, "every.weights['a'] must be above 0, not 0.0"),
    ],
)
def test_a_wrong_value_is_refused_with_its_name_and_what_it_may_be(name, value, message):
    with pytest.raises(ConfigError) as caught:
        Everything(**{name: value})
    assert str(caught.value) == message
    with pytest.raises(ConfigError):
        dataclasses.replace(Everything(), **{name: value})


@given(st.floats(allow_nan=True, allow_infinity=True) | st.integers())
def test_bounds_allow_what_they_say(number):
    allowed = {
        "positive": 0.0 < number <= LARGEST,
        "non_negative": 0.0 <= number <= LARGEST,
        "share": 0.0 <= number <= 1.0,
        "positive_share": 0.0 < number <= 1.0,
        "share_below_one": 0.0 <= number < 1.0,
        "number": abs(number) <= LARGEST,
        "between": -1.0 < number <= 2.0,
        "unlimited": 0.0 < number <= LARGEST or number == math.inf,
        "optional": 0.0 < number <= LARGEST,
        "count": isinstance(number, int) and 1 <= number <= LARGEST,
        "side": isinstance(number, int) and number in (8, 16, 32, 64),
    }
    for name, is_allowed in allowed.items():
        if is_allowed:
            assert getattr(Everything(**{name: number}), name) == number
        else:
            with pytest.raises(ConfigError, match=rf"^every\.{name} must be .*, not "):
                Everything(**{name: number})


def test_numpys_scalars_are_numbers():
    assert Everything(positive=np.float32(2.0), count=np.int64(3)) == Everything(
        positive=2.0, count=3
    )


def test_values_from_a_file_are_refused_with_the_files_name():
    with pytest.raises(ConfigError, match=r"^run\.json\.inner\.range_max must be above 0, not -1$"):
        from_dict(Outer, {"inner": {"range_max": -1}}, "run.json")


def test_settings_are_frozen_and_survive_pickling():
    config = Outer(particles=5, inner=Inner(range_max=2.0))
    assert pickle.loads(pickle.dumps(config)) == config
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.particles = 3


class Ranges(Settings):
    low: float = 0.0
    high: float = 1.0

    def _check(self) -> None:
        if self.low > self.high:
            raise ConfigError(f"low must not be above high, not {self.low} and {self.high}")


class LongRanges(Ranges):
    high: Annotated[float, Within(ge=10.0)] = 10.0
    steps: Count = 3


def test_a_subclass_keeps_the_rules_and_may_narrow_the_bounds():
    assert [entry.name for entry in dataclasses.fields(LongRanges)] == ["low", "high", "steps"]
    with pytest.raises(ConfigError, match="high must be at least 10, not"):
        LongRanges(high=5.0)
    with pytest.raises(ConfigError, match="low must not be above high"):
        LongRanges(low=11.0)
    assert Ranges(high=5.0).high == 5.0


class DrawArguments(Arguments):
    """Draw."""

    map_size: Count = 4
    """Side of the map."""
    config: Outer = field(default_factory=Outer)


def test_the_command_line_shows_help_and_defaults_and_refuses_by_option(capsys):
    parsed = tyro.cli(DrawArguments, args=["--map-size", "7", "--config.inner.range-max", "2"])
    assert parsed == DrawArguments(7, Outer(inner=Inner(2.0)))
    with pytest.raises(ConfigError, match=r"^--map-size must be at least 1, not 0$"):
        tyro.cli(DrawArguments, args=["--map-size", "0"])
    with pytest.raises(ConfigError, match=r"^inner\.range_max must be above 0, not -1\.0$"):
        tyro.cli(DrawArguments, args=["--config.inner.range-max", "-1"])
    with pytest.raises(SystemExit):
        tyro.cli(DrawArguments, args=["--help"])
    shown = " ".join(capsys.readouterr().out.split())
    assert "--map-size INT Side of the map. (default: 4)" in shown
    assert "--config.inner.range-max FLOAT" in shown
    assert "Largest range. (default: 3.5)" in shown

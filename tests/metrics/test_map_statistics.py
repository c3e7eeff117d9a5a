"""Map statistics on pictures whose numbers are known, and the two-sample test on samples whose answer is."""

import numpy as np
import pytest

from slamgym.core.errors import ConfigError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.metrics.map_statistics import (
    displacement_statistics,
    map_statistics,
    open_border,
    wall_thickness,
    wall_tilt,
)
from slamgym.metrics.two_sample import two_sample_test


def room(thickness: int = 1, size: int = 60):
    cells = np.full((size, size), UNKNOWN, dtype=np.uint8)
    cells[10:50, 10:50] = OCCUPIED
    cells[10 + thickness : 50 - thickness, 10 + thickness : 50 - thickness] = FREE
    return cells


def test_shares_and_blobs_of_a_plain_room() -> None:
    statistics = map_statistics(room(), 0.05)
    assert statistics["share_free"] == pytest.approx(38**2 / 42**2)
    assert statistics["share_occupied"] == pytest.approx((40**2 - 38**2) / 42**2)
    assert statistics["blobs_per_100m2"] == pytest.approx(100.0 / (38**2 * 0.05**2))
    assert statistics["specks_per_100m2"] == 0.0
    assert statistics["open_border"] == 0.0
    assert statistics["tilt_deg"] == pytest.approx(0.0, abs=0.1)
    patterns = sum(value for name, value in statistics.items() if name.startswith("pattern_"))
    assert patterns == pytest.approx(1.0)


def test_thicker_walls_count_as_thicker_and_a_line_as_one() -> None:
    thickness = [wall_thickness(room(n) == OCCUPIED) for n in (1, 2, 3, 4, 5)]
    assert thickness[0] == pytest.approx(1.0)
    assert all(np.diff(thickness[1:]) > 0.0)


def test_a_missing_wall_is_an_open_border() -> None:
    cells = room()
    cells[10, 11:49] = UNKNOWN
    assert open_border(cells == FREE, cells == UNKNOWN) == pytest.approx(0.25, abs=0.02)


def test_a_turned_wall_shows_its_tilt() -> None:
    rows, cols = np.indices((200, 200))
    for degrees in (-10.0, 5.0, 20.0):
        slope = np.tan(np.radians(degrees))
        line = np.abs((100 - rows) - slope * (cols - 100)) < 1.0
        assert wall_tilt(line) == pytest.approx(degrees, abs=1.0)


def test_displacement_is_the_distance_from_the_cad_face() -> None:
    cad = room(5) != FREE
    cells = room(5)
    exact = displacement_statistics(np.where(_faces(cad), OCCUPIED, cells).astype(np.uint8), cad, 0.05, rng())
    moved = np.full_like(cells, UNKNOWN)
    moved[_faces(cad)] = OCCUPIED
    shifted = displacement_statistics(np.roll(moved, 3, axis=1), cad, 0.05, rng())
    assert exact["missed_share"] == 0.0
    assert displacement_statistics(moved, cad, 0.05, rng())["displacement_p95_m"] == 0.0
    assert shifted["displacement_p95_m"] == pytest.approx(0.15)
    assert shifted["displacement_p50_m"] < 0.15


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _faces(cad):
    free = np.pad(~cad, 1)
    near = np.zeros_like(cad)
    for i in range(3):
        for j in range(3):
            near |= free[i : i + cad.shape[0], j : j + cad.shape[1]]
    return near & cad


def samples(shift: float, seed: int, n: int = 60) -> list[dict[str, float]]:
    values = np.random.default_rng(seed).standard_normal((n, 4))
    values[:, 0] += shift
    return [{f"s{i}": float(v) for i, v in enumerate(row)} for row in values]


@pytest.mark.parametrize("learner", ["gradient_boosting", "extra_trees"])
def test_different_samples_are_distinguished_and_equal_ones_are_not(learner) -> None:
    pytest.importorskip("sklearn")
    plans = [str(i) for i in range(60)]
    same = two_sample_test(samples(0.0, 0), samples(0.0, 1), plans, plans, learner, repeats=1)
    assert same.low < 0.5 < same.high + 0.05
    assert same.accuracy < 0.65
    different = two_sample_test(samples(0.0, 0), samples(4.0, 1), plans, plans, learner, repeats=1)
    assert different.accuracy > 0.9
    assert different.telling[0][0] == "s0"


def test_too_few_plans_for_the_folds_are_refused() -> None:
    with pytest.raises(ConfigError, match="as many plans"):
        two_sample_test(samples(0, 0, 4), samples(0, 1, 4), list("abca"), list("abca"))

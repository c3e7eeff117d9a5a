import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.agents.rules import FrontierTour
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_features import (
    CANDIDATE_FEATURES,
    GLOBAL_FEATURES,
    expected_unseen_share,
)
from slamgym.planning.frontier_feature_kernels import coarse_cells
from slamgym.planning.open_tour import EXACT_PLACES


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 40))
def test_coarse_cells_hold_each_cell_once_and_stay_on_the_map(seed, count):
    shape = (7, 9)
    cells = np.random.default_rng(seed).integers(0, (16, 20), (count, 2)).astype(np.int32)
    expected = np.unique(np.minimum(cells // 2, np.array(shape) - 1), axis=0).reshape(-1, 2)
    assert (coarse_cells(cells, 2, shape) == expected).all()


def test_the_first_of_the_tour_is_what_the_rule_chooses_and_a_room_is_expected_behind_each_door():
    env = ExploreFrontiersEnv("procedural:home:loops", localization="ground_truth")
    observation, _ = env.reset(seed=4)
    expected = CANDIDATE_FEATURES.index("expected")
    tour = CANDIDATE_FEATURES.index("tour")
    detour = CANDIDATE_FEATURES.index("tour_detour")
    several = 0
    for _ in range(25):
        candidates = env.loop.candidates
        rows = observation["candidates"][: len(candidates)]
        choice = int(rows[:, tour].argmax()) if len(candidates) else 0
        if len(candidates) > 1:
            several += 1
            assert choice == FrontierTour()(env.loop).argmax()
            np.testing.assert_allclose(
                np.sort(1.0 / rows[:, tour]), np.arange(1, len(rows) + 1), rtol=1e-6
            )
            assert (rows[:, detour] >= 0.0).all()
            if len(candidates) <= EXACT_PLACES:
                assert rows[choice, detour] == pytest.approx(0.0, abs=1e-6)
            ways_on = [one.cells for one in env.loop.ways_on()]
            areas = (10.0 ** (2.0 * rows[:, expected]) - 1.0) / 10.0
            for area, one in zip(areas, candidates, strict=True):
                is_wide = any(np.array_equal(one.frontier.cells, cells) for cells in ways_on)
                extent = np.hypot(*np.ptp(one.points, axis=0))
                assert area == pytest.approx(is_wide * extent**2, rel=1e-3, abs=1e-5)
            measured = observation["globals"][GLOBAL_FEATURES.index("unseen_share")]
            assert measured == pytest.approx(
                1.0 + 0.25 * np.log10(expected_unseen_share(env.loop)), abs=1e-5
            )
        observation, *_ = env.step(choice)
    assert several > 5

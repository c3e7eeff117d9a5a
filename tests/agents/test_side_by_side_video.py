import dataclasses

import cv2
import imageio
import numpy as np
import pytest
import shapely

from slamgym.agents.evaluation.report import draw_coverage
from slamgym.agents.evaluation.side_by_side_video import choose_trial, film_side_by_side
from slamgym.agents.evaluation.trial import TrialConfig
from slamgym.cad import FloorPlan
from slamgym.envs import ExploreConfig
from slamgym.envs.plan_cache import listed_plans
from slamgym.slam import SlamConfig

PAIR = ("nearest", "explore_lite")
# 2 s of robot time: a film of some frames.
CONFIG = TrialConfig(minutes=2.0 / 60.0, env=ExploreConfig(slam=SlamConfig(mode="ground_truth")))


@pytest.fixture
def plans():
    return listed_plans([FloorPlan(name, shapely.box(0.0, 0.0, 4.0, 3.0)) for name in ("a", "b")])


@pytest.fixture
def trials(make_trial):
    """The left explorer gains more on plan b."""
    return [
        make_trial(name, plan, seconds)
        for name, times in zip(PAIR, ((90.0, 50.0), (100.0, 100.0)), strict=True)
        for plan, seconds in zip("ab", times, strict=True)
    ]


def frames_of(path):
    film = cv2.VideoCapture(str(path))
    frames = []
    while (shot := film.read())[0]:
        frames.append(shot[1])
    film.release()
    return frames


def test_a_film_shows_both_explorations_side_by_side(tmp_path, plans, trials):
    film_side_by_side(plans, trials, PAIR, CONFIG, tmp_path / "film.mp4")
    frames = frames_of(tmp_path / "film.mp4")
    assert len(frames) > 40  # 2 s of film at the end
    rows, cols, _ = frames[0].shape
    assert (rows % 2, cols % 2) == (0, 0)
    left, right = frames[0][:, : cols // 2].astype(int), frames[0][:, cols // 2 :].astype(int)
    heading = np.s_[:40]
    assert np.abs(left[heading] - right[heading]).max() > 100  # other names
    assert np.abs(left[60:] - right[60:]).mean() < 3.0  # the same start; the codec loses a little
    assert list(tmp_path.iterdir()) == [tmp_path / "film.mp4"]


def test_the_plan_to_film_is_where_the_left_one_gains_most(tmp_path, plans, trials, monkeypatch):
    filmed = []

    def no_frames(plan, seed, name, config, stride):
        filmed.append(plan.id)
        yield np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr("slamgym.agents.evaluation.side_by_side_video._frames", no_frames)
    film_side_by_side(plans, trials, PAIR, CONFIG, tmp_path / "film.mp4")
    assert filmed == ["b", "b"]


def test_a_plan_that_the_first_scan_shows_is_no_gain(trials, make_trial):
    at_once = make_trial(PAIR[1], "c")
    at_once = dataclasses.replace(at_once, time_to=dict.fromkeys(at_once.time_to, 0.0))
    both = [*trials, make_trial(PAIR[0], "c", 10.0), at_once]
    assert choose_trial(both, PAIR).plan == "b"


def test_a_plot_of_explorers_that_reach_a_level_and_of_one_that_never_does(tmp_path, trials, make_trial):
    pytest.importorskip("matplotlib")
    slow = [dataclasses.replace(make_trial("slow", plan, reached=0.6), finished=False) for plan in "ab"]
    draw_coverage([*trials, *slow], tmp_path / "plot.png")
    picture = imageio.v3.imread(tmp_path / "plot.png")
    assert picture.shape[1] > picture.shape[0] > 400
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 20  # not an empty page

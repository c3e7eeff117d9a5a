"""Pictures of an exploration."""

import sys

import numpy as np
import pytest

from slamgym.cad import FloorPlan
from slamgym.core.errors import SlamgymError
from slamgym.envs import ExploreEnv
from slamgym.viz import exploration as r
from slamgym.viz.canvas import (
    BELIEVED_COLOUR,
    FRAME_HEIGHT,
    FRAME_WIDTH,
    TRUE_COLOUR,
    UNKNOWN_TINT,
    WALL_TINT,
)
from slamgym.viz.window import Window


def test_a_frame_has_its_size_and_both_worlds(flat: FloorPlan):
    env = ExploreEnv(flat, render_mode="rgb_array", localization="ground_truth")
    env.reset(seed=1, options={"start": (1.0, 1.0, 0.0)})
    first = env.render()
    for _ in range(10):
        env.step((1.0, 0.2))
    frame = env.render()
    assert frame.shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)
    assert frame.dtype == np.uint8
    assert not np.array_equal(first, frame)
    left, right = np.split(frame, 2, axis=1)
    for panel, colours in (
        (left, (TRUE_COLOUR, WALL_TINT, r.SEEN_TINT)),
        (right, (BELIEVED_COLOUR, WALL_TINT, UNKNOWN_TINT)),
    ):
        for colour in colours:
            assert (panel == colour).all(axis=2).any()
    assert not (left == BELIEVED_COLOUR).all(axis=2).any()


def test_the_plan_and_the_map_are_drawn_at_one_scale(flat: FloorPlan):
    """Where the map shows a wall, the plan's panel shows one too, within a few pixels."""
    env = ExploreEnv(flat, render_mode="rgb_array", localization="ground_truth", lidar="exact")
    env.reset(seed=1, options={"start": (2.0, 2.0, 0.0)})
    for _ in range(20):
        env.step((0.0, 1.0))
    frame = env.render()
    # Lines are smoothed, so a wall is what is dark.
    plan, belief = (r.panel_of(frame, i).mean(axis=2) < 140 for i in (0, 1))
    belief &= (r.panel_of(frame, 1) == WALL_TINT).all(axis=2)
    rows, cols = np.nonzero(belief)
    assert len(rows) > 500
    near = [
        plan[max(0, row - 4) : row + 5, max(0, col - 4) : col + 5].any()
        for row, col in zip(rows, cols, strict=True)
    ]
    assert np.mean(near) > 0.95


def test_large_and_furnished_plans_can_be_drawn():
    import shapely

    hall = FloorPlan(
        "warehouse_with_a_long_name",
        shapely.box(0, 0, 150, 40).difference(shapely.box(60, 15, 90, 25)),
    )
    env = ExploreEnv(
        hall, render_mode="rgb_array", localization="dead_reckoning", clutter={"people": 2}
    )
    env.reset(seed=0)
    env.step((1.0, 0.0))
    assert env.render().shape == (FRAME_HEIGHT, FRAME_WIDTH, 3)


def test_no_render_mode_draws_nothing(flat: FloorPlan):
    env = ExploreEnv(flat)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


def test_human_mode_shows_every_step(flat: FloorPlan, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = ExploreEnv(flat, render_mode="human", lidar={"rate": 50.0})
    env.reset(seed=0)
    env.step((1.0, 0.0))
    assert env._window._screen.get_size() == (FRAME_WIDTH, FRAME_HEIGHT)
    env.close()
    assert env._window is None
    env.close()


def test_human_mode_without_pygame_says_what_to_install(
    flat: FloorPlan, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = ExploreEnv(flat, render_mode="human")
    with pytest.raises(SlamgymError, match=r"pip install .*slamgym\[human\]"):
        env.reset(seed=0)


def test_a_window_without_a_display_and_one_that_is_closed_are_one_clear_error(
    monkeypatch: pytest.MonkeyPatch,
):
    pygame = pytest.importorskip("pygame")
    picture = np.zeros((20, 30, 3), np.uint8)
    monkeypatch.setenv("SDL_VIDEODRIVER", "no_such_driver")
    with pytest.raises(SlamgymError, match="without a display, write a film"):
        Window("title").show(picture)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    window = Window("title")
    window.show(picture)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    with pytest.raises(SlamgymError, match="was closed"):
        window.show(picture)
    window.close()

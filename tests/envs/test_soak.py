"""What must hold however long an environment runs; ``benchmarks/simulation/soak.py`` takes a million steps."""

import gc
import tracemalloc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.cad import FloorPlan, open_plans
from slamgym.envs import ExploreEnv
from slamgym.envs.plan_cache import PlanCache
from slamgym.sim import RobotConfig

KEPT_PER_PLAN = 100e3
"""Bytes that an environment may keep of a plan that it has left."""
KEPT_PER_STEP = 60.0
"""Bytes that may be left of a step once all plans were seen; a single pose that is kept takes more."""


@pytest.fixture
def traced() -> Iterator[None]:
    tracemalloc.start()
    yield
    tracemalloc.stop()


def explore_all(env: ExploreEnv, plans: list[str], steps: int = 40) -> float:
    """Explore each plan for some steps; the memory in use at the end [bytes]."""
    for plan in plans:
        env.reset(options={"plan": plan})
        for _ in range(steps):
            env.step((1.0, 0.05))  # until it meets a wall
        env.map_error()
    env.reset(options={"plan": plans[0]})
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def test_memory_stays_flat_once_all_plans_were_seen(traced) -> None:
    env = ExploreEnv("bundled", localization="ground_truth")
    plans = list(open_plans("bundled").ids)[::3]
    env.reset(seed=0)
    first = explore_all(env, plans[:1])
    seen = explore_all(env, plans)
    assert (seen - first) / (len(plans) - 1) < KEPT_PER_PLAN
    growth = explore_all(env, plans, steps=100) - seen
    assert growth / (100 * len(plans)) < KEPT_PER_STEP


def test_a_plan_that_was_refused_is_not_kept() -> None:
    loaded: list[weakref.ref] = []

    class Source:
        ids = ("slit", "room")

        def __len__(self) -> int:
            return len(self.ids)

        def load(self, plan_id: str) -> FloorPlan:
            plan = FloorPlan(plan_id, shapely.box(0, 0, 4, 0.1 if plan_id == "slit" else 4))
            loaded.append(weakref.ref(plan))
            return plan

    cache = PlanCache(Source(), RobotConfig())
    rng = np.random.default_rng(0)
    drawn = {cache.draw(rng).plan.id for _ in range(10)}
    gc.collect()
    kept = [plan() for plan in loaded]
    assert drawn == {"room"}
    assert len(kept) == 2
    assert sorted(plan.id for plan in kept if plan is not None) == ["room"]


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["continuous", "discrete", "pushing"]),
    st.sampled_from([0.0, 0.5]),
)
@settings(max_examples=6)
def test_the_robot_stays_on_the_floor_whatever_it_does(
    seed: int, kind: str, furniture: float
) -> None:
    env = ExploreEnv(
        "bundled",
        localization="ground_truth",
        actions="discrete" if kind == "discrete" else "normalized",
        clutter={"furniture": furniture},
    )
    env.action_space.seed(seed)
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    free = env.plan.free_space.difference(
        shapely.union_all([shapely.Polygon(corners) for corners in env.clutter.solids()])
    )
    for _ in range(15):
        # Held for up to 6 s, as an action that changes at every step leads nowhere.
        action = (9.0 * rng.standard_normal(2)) if kind == "pushing" else env.action_space.sample()
        for _ in range(int(rng.integers(1, 30))):
            env.step(action)
            centre = shapely.Point(env.simulation.true_pose[:2])
            assert free.contains(centre)
            assert free.boundary.distance(centre) > env.config.robot.radius - 1e-6

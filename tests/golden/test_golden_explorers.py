"""What every explorer does, action by action."""

import pytest

from slamgym.agents.registry import EXPLORERS, make_explorer
from slamgym.cad import open_plans
from slamgym.envs import ExploreConfig, ExploreEnv
from slamgym.slam import SlamConfig

# A small home that most explore to the end, an office, and a bundled home: where from, which plan, seconds.
SITES = {
    "small home": ("procedural:home:3", "home_3_00003", 150.0),
    "office": ("procedural:office:3", "office_3_00002", 80.0),
    "home": ("bundled", "home_000002", 80.0),
}
TRUE_POSES = ExploreConfig(slam=SlamConfig(mode="ground_truth"))
LOCALISED = ExploreConfig(slam=SlamConfig(mode="rbpf", particles=6))


def trace(golden, name, site, config):
    """Let an explorer drive, and say what it did."""
    source, plan_id, seconds = SITES[site]
    env = ExploreEnv(open_plans(source).load(plan_id), config.for_explorer(), time_limit=seconds)
    explorer = make_explorer(name, env.explorer_context(), 5)
    observation, info = env.reset(seed=5)
    actions, over = [], False
    while not over:
        action, _ = explorer.predict(observation)
        actions.append(action)
        if explorer.finished:
            break
        observation, _, _, over, info = env.step(action)
    return {
        "actions": len(actions),
        "finished": explorer.finished,
        "path length": round(info["path_length"], 6),
        "coverage": round(info["coverage"], 6),
        "collisions": info["collisions"],
        "last pose": [round(float(value), 6) for value in info["true_pose"]],
        "actions digest": golden.rounded_digest(actions),
        "map digest": golden.digest(observation["map"]),
    }


@pytest.mark.parametrize("site", SITES)
@pytest.mark.parametrize("name", EXPLORERS)
def test_actions_at_true_poses(golden, name, site):
    golden.check(f"actions/{name}/{site}", trace(golden, name, site, TRUE_POSES))


@pytest.mark.parametrize("name", EXPLORERS)
def test_actions_on_a_map_of_the_particle_filter(golden, name):
    golden.check(f"actions/{name}/home/rbpf", trace(golden, name, "home", LOCALISED))

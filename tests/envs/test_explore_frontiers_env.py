"""The environment at the level of decisions."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from slamgym.core.errors import ConfigError
from slamgym.envs import ExploreFrontiersEnv
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from slamgym.envs.rewards import FRONTIER_REWARD, MOST_MISSING

SMALL = {"observation": {"map_size": 24.0}, "localization": "ground_truth"}


@pytest.fixture
def env(two_room_plan):
    return ExploreFrontiersEnv(two_room_plan, **SMALL)


@pytest.fixture
def two_room_plan():
    import shapely

    from slamgym.cad import FloorPlan

    left = shapely.box(0.0, 0.0, 5.0, 5.0)
    right = shapely.box(5.1, 0.0, 10.0, 5.0)
    door = shapely.box(4.9, 2.0, 5.2, 3.0)
    return FloorPlan("two-rooms", shapely.union_all([left, right, door]))


def nearest(observation, env):
    """The row with the shortest path."""
    there = observation["mask"] > 0.5
    return int(np.where(there, observation["lengths"][0, 1:], np.inf).argmin())


def play(env, choose=nearest, seed=0, options=None):
    observation, info = env.reset(seed=seed, options=options)
    steps = [(observation, 0.0, info)]
    over = False
    while not over:
        observation, reward, terminated, truncated, info = env.step(choose(observation, env))
        over = terminated or truncated
        steps.append((observation, reward, info))
    return steps, terminated


def test_gymnasium_accepts_the_environment(two_room_plan):
    env = gym.make("slamgym/ExploreFrontiers-v4", plans=two_room_plan, **SMALL)
    check_env(env.unwrapped, skip_render_check=True)


def test_choosing_the_nearest_explores_the_building(env):
    steps, terminated = play(env)
    info = steps[-1][2]
    assert terminated
    assert info["is_success"]
    assert info["coverage"] > 0.99
    assert info["map_error"] < 0.1
    assert 3 < len(steps) < 60


def test_the_same_seed_gives_the_same_episode(env):
    first, _ = play(env, seed=3)
    second, _ = play(env, seed=3)
    assert len(first) == len(second)
    for (a, ra, _), (b, rb, _) in zip(first, second, strict=True):
        assert ra == rb
        for key in a:
            np.testing.assert_array_equal(a[key], b[key])


def test_masked_rows_are_empty(env):
    steps, _ = play(env)
    for observation, _, _ in steps[:-1]:
        count = int(observation["mask"].sum())
        assert count >= 1
        assert not observation["frontiers"][count:].any()
        assert not observation["lengths"][count + 1 :].any()
        assert not observation["lengths"][:, count + 1 :].any()


def test_the_mask_of_actions_is_that_of_the_observation(env):
    seen = []

    def choose(observation, env):
        seen.append((observation["mask"], env.action_masks()))
        return nearest(observation, env)

    play(env, choose)
    assert all(observed.shape == mask.shape and (observed == mask).all() for observed, mask in seen)


def test_a_row_s_number_says_nothing_and_those_offered_are_the_nearest(two_room_plan):
    """Each row holds the shortest path as often as any other, within four standard deviations."""
    env = ExploreFrontiersEnv(two_room_plan, loop={"max_candidates": 2}, **SMALL)
    column = CANDIDATE_FEATURES.index("path_length")
    firsts = []
    for seed in range(12):
        for observation, _, _ in play(env, seed=seed)[0]:
            if observation["mask"].sum() == 2:
                firsts.append(int(observation["frontiers"][:2, column].argmin()))
    spread = 4.0 * 0.5 / len(firsts) ** 0.5
    assert len(firsts) > 40
    assert 0.5 - spread < np.mean(firsts) < 0.5 + spread


def test_done_ends_the_episode_and_is_charged_for_what_is_missing(two_room_plan):
    env = ExploreFrontiersEnv(
        two_room_plan, reward={"missing": 3.0, "shaping": 0.0}, loop={"promise": {}}, **SMALL
    )
    observation, info = env.reset(seed=0)
    done = env.action_space.n - 1
    assert done == env.loop_config.max_candidates
    while not env.action_masks()[done]:  # a map of less than a small home promises nothing
        observation, *_ = env.step(nearest(observation, env))
    _, reward, terminated, truncated, info = env.step(done)
    assert terminated
    assert not truncated
    missing = 98.0 - 100.0 * info["coverage"]
    assert missing > MOST_MISSING  # more isn't charged for
    assert info["reward_terms"]["missing"] == pytest.approx(-3.0 * MOST_MISSING)
    assert reward == pytest.approx(sum(info["reward_terms"].values()))


def passing_over(plan, **loop):
    return ExploreFrontiersEnv(plan, passes_over=True, loop=loop, **SMALL)


def offered(env):
    return [one.frontier.centroid for one in env.loop.candidates]


def test_what_is_passed_over_takes_no_time_and_is_not_offered_again_before_the_map_has_changed_there(
    two_room_plan,
):
    env = passing_over(two_room_plan)
    observation, info = env.reset(seed=1)
    k = env.loop_config.max_candidates
    while len(env.loop.candidates) < 2:
        observation, *_ = env.step(nearest(observation, env))
    before = offered(env)
    row = nearest(observation, env)
    passed = env.loop.candidates[env.order[row]].frontier
    observation, reward, _, _, info = env.step(k + row)
    assert (reward, info["duration"]) == (0.0, 0.0)
    assert offered(env) == [one for one in before if one != passed.centroid]
    over = env.loop.finished
    known = known_near(env, passed.middle)
    while not over and abs(known_near(env, passed.middle) - known) < 0.5:
        assert all(np.hypot(*np.subtract(passed.centroid, one)) > 0.25 for one in offered(env))
        observation, _, over, _, info = env.step(nearest(observation, env))


def known_near(env, middle):
    """Known area within a metre of a place by both coordinates [m2]."""
    costmap = env.loop.navigator.costmap
    rows, cols = np.nonzero(costmap.costs != 255)
    apart = np.abs(costmap.frame.to_points(rows, cols) - middle).max(axis=1)
    return np.count_nonzero(apart <= 1.0 + 0.01) * costmap.frame.resolution**2


def test_who_passes_everything_over_ends_soon_with_the_promise_unkept(two_room_plan):
    """What is passed over stays a way on: the promise can't be kept by looking away."""
    env = passing_over(two_room_plan, promise={})
    k = env.loop_config.max_candidates

    def pass_over(observation, env):
        mask = env.action_masks()
        count = int(observation["mask"].sum())
        assert mask[k : k + count].all()
        assert not mask[k + count : 2 * k].any()
        return k if count else 0

    steps, terminated = play(env, pass_over)
    info = steps[-1][2]
    assert terminated
    assert info["coverage"] < 0.9
    assert info["time"] < 60.0
    assert env.action_space.n == 2 * k + 1


@pytest.mark.parametrize("seed", range(3))
def test_random_actions_of_all_kinds_end_every_exploration(two_room_plan, seed):
    env = passing_over(two_room_plan, promise={})
    env.action_space.seed(seed)

    def at_random(_, env):
        return int(env.action_space.sample(env.action_masks().astype(np.int8)))

    steps, terminated = play(env, at_random, seed)
    assert terminated
    assert sum(info["duration"] for _, _, info in steps) > 0.0


def test_without_a_promise_there_is_no_done(env):
    env.reset(seed=0)
    assert env.action_space.n == env.loop_config.max_candidates


def test_the_drive_along_paths_explores_as_the_physics_do(two_room_plan):
    """Everything is seen; the means of 8 episodes, each known to a twentieth, agree within two and a half of these."""
    times = {}
    for drive in ("physics", "path"):
        env = ExploreFrontiersEnv(two_room_plan, drive=drive, **SMALL)
        ends = [play(env, seed=seed)[0][-1][2] for seed in range(8)]
        times[drive] = np.mean([info["time"] for info in ends])
        assert min(info["coverage"] for info in ends) > 0.98
    assert times["path"] == pytest.approx(times["physics"], rel=0.18)


def test_durations_add_up_to_the_time(env):
    steps, _ = play(env)
    begin = steps[0][2]["time"]
    assert sum(info["duration"] for _, _, info in steps) == pytest.approx(
        steps[-1][2]["time"] - begin
    )
    # A decision lasts no longer than the horizon, but for the time until the next map or a forced look.
    lasting = [info["duration"] for _, _, info in steps[1:-1]]
    assert max(lasting) < 40.0


def test_undiscounted_shaping_and_time_make_up_the_reward(env):
    """With discount 1 the potential telescopes: only its first value counts, for in the end it is 0."""
    steps, _ = play(env)
    begin = steps[0][2]
    end = steps[-1][2]
    seen = 1.0 - begin["coverage"]
    duration = end["time"] - begin["time"]
    contacts = sum(info["reward_terms"].get("collision", 0.0) for _, _, info in steps[1:])
    expected = FRONTIER_REWARD.shaping * seen - FRONTIER_REWARD.time * duration + contacts
    assert sum(reward for _, reward, _ in steps) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("discount", [1.0, 0.99])
def test_saying_done_ends_the_episode_with_the_bonus_and_no_potential(two_room_plan, discount):
    reward = {"completion": 1.0, "shaping": 2.0, "time": 0.0, "collision": 0.0}
    env = ExploreFrontiersEnv(
        two_room_plan,
        **SMALL,
        reward=reward,
        discount=discount,
        loop={"promise": {"seen": 0.5, "confidence": 0.1}},
    )
    observation, first = env.reset(seed=0)
    sums = {"completion": 0.0, "shaping": 0.0}
    over = False
    while not over:
        observation, total, over, _, info = env.step(nearest(observation, env))
        terms = info["reward_terms"]
        assert total == pytest.approx(sum(terms.values()))
        for name in sums:
            sums[name] += terms.get(name, 0.0)
    last = discount ** max(0.0, info["duration"] - env.config.control_step)
    assert info["coverage"] > 0.5
    assert sums["completion"] == pytest.approx(last)
    if discount == 1.0:  # the potential is 0 in the end, whatever was seen
        assert sums["shaping"] == pytest.approx(2.0 * (1.0 - first["coverage"]))


def test_rewards_within_a_step_are_discounted_by_seconds(two_room_plan):
    reward = {"coverage_gain": 0.0, "time": 1.0, "collision": 0.0, "shaping": 0.0}
    env = ExploreFrontiersEnv(two_room_plan, reward=reward, discount=0.9, **SMALL)
    for _, reward_sum, info in play(env)[0][1:]:
        count = round(info["duration"] / 0.2)
        assert reward_sum == pytest.approx(
            -0.2 * sum(0.9 ** (0.2 * i) for i in range(count)), abs=1e-4
        )


def test_a_masked_action_chooses_the_first_candidate(env):
    first, _ = env.reset(seed=1)
    nothing = int(first["mask"].sum())
    masked = env.step(nothing)
    first, _ = env.reset(seed=1)
    plain = env.step(nearest(first, env))
    np.testing.assert_array_equal(masked[0]["frontiers"], plain[0]["frontiers"])
    assert masked[1] == plain[1]


def test_observations_hold_no_truth(two_room_plan):
    """Rewarding by the truth changes rewards and info, but not a bit of what is observed."""
    plain = ExploreFrontiersEnv(two_room_plan, **SMALL)
    measured = ExploreFrontiersEnv(
        two_room_plan,
        reward=dataclasses.replace(FRONTIER_REWARD, map_error=5.0),
        reward_terms={"mine": (1.0, lambda step: step.coverage)},
        **SMALL,
    )
    for (a, ra, _), (b, rb, _) in zip(
        play(plain, seed=2)[0][1:], play(measured, seed=2)[0][1:], strict=True
    ):
        assert ra != rb
        for key in a:
            np.testing.assert_array_equal(a[key], b[key])


def test_the_coverage_goal_ends_the_episode(two_room_plan):
    env = ExploreFrontiersEnv(two_room_plan, coverage_goal=0.6, **SMALL)
    steps, terminated = play(env)
    assert terminated
    assert 0.6 <= steps[-1][2]["coverage"] < 0.95


def test_the_time_limit_truncates(two_room_plan):
    env = ExploreFrontiersEnv(two_room_plan, time_limit=8.0, **SMALL)
    steps, terminated = play(env)
    assert not terminated
    assert steps[-1][2]["time"] == pytest.approx(8.0)
    # Who goes on regardless is told again, rather than left to step forever.
    assert env.step(0)[1:4] == (0.0, False, True)


def test_fewer_candidates_can_be_asked_for(two_room_plan):
    env = ExploreFrontiersEnv(two_room_plan, loop={"max_candidates": 3}, **SMALL)
    observation, _ = env.reset(seed=0)
    assert env.action_space.n == 3
    assert observation["frontiers"].shape == (3, len(CANDIDATE_FEATURES))
    assert observation["globals"].shape == (len(GLOBAL_FEATURES),)
    assert env.observation_space.contains(observation)


@pytest.mark.parametrize(
    "settings",
    [
        {"loop": {"horizn": 3.0}},
        {"discount": 0.0},
        {"timelimit": 4.0},
        {"drive": "paths"},
        {"drive": "path", "localization": "pose_graph"},
    ],
)
def test_unknown_and_senseless_settings_are_refused(two_room_plan, settings):
    with pytest.raises(ConfigError):
        ExploreFrontiersEnv(two_room_plan, **{**SMALL, **settings})


def test_a_step_before_the_first_reset_is_refused(env):
    with pytest.raises(gym.error.ResetNeeded):
        env.step(0)

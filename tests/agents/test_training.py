"""Training: the semi-Markov estimates, the curriculum, a whole small run, and going on with it."""

import dataclasses

import numpy as np
import pytest

from slamgym.agents.plan_splits import split_of
from slamgym.agents.rl.train_config import Curriculum, ImitationConfig, PPOConfig, TrainConfig
from slamgym.agents.rl.training_envs import StagedPlans, draw_plans
from slamgym.agents.scoring import NetworkConfig
from slamgym.cad import open_plans
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.envs.frontier_features import CANDIDATE_FEATURES

torch = pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from stable_baselines3.common.buffers import DictRolloutBuffer  # noqa: E402

from slamgym.agents.pretrained_policy import read_policy  # noqa: E402
from slamgym.agents.rl import imitation  # noqa: E402
from slamgym.agents.rl import train as train_module  # noqa: E402
from slamgym.agents.rl.imitation import EXPERTS  # noqa: E402
from slamgym.agents.rl.semi_markov import SemiMarkovBuffer  # noqa: E402
from slamgym.agents.rl.train import train  # noqa: E402
from slamgym.agents.rl.training_callbacks import read_validation  # noqa: E402
from slamgym.agents.rl.training_envs import make_env  # noqa: E402
from slamgym.envs.frontier_features import frontier_observation_space  # noqa: E402

TINY = TrainConfig(
    plan_count=2,
    steps=24,
    num_envs=2,
    ppo=PPOConfig(n_steps=6, batch_size=6, n_epochs=1),
    evaluate_every=0,
    checkpoint_every=12,
    time_limit=40.0,
)


def fill(buffer, durations, rng):
    space = frontier_observation_space(2)
    for step in range(buffer.buffer_size):
        observation = {key: np.stack([box.sample()] * buffer.n_envs) for key, box in space.spaces.items()}
        if isinstance(buffer, SemiMarkovBuffer):
            buffer.durations[step] = durations[step]
        buffer.add(
            observation,
            np.zeros((buffer.n_envs, 1)),
            rng.normal(size=buffer.n_envs),
            rng.random(buffer.n_envs) < 0.2,
            torch.as_tensor(rng.normal(size=buffer.n_envs)),
            torch.zeros(buffer.n_envs),
        )


def make_buffer(kind, gamma):
    from gymnasium import spaces

    return kind(
        8, frontier_observation_space(2), spaces.Discrete(2), "cpu", gae_lambda=0.9, gamma=gamma, n_envs=3
    )


def test_steps_of_one_second_give_the_usual_advantages():
    ours, theirs = make_buffer(SemiMarkovBuffer, 0.97), make_buffer(DictRolloutBuffer, 0.97)
    for buffer in (ours, theirs):
        fill(buffer, np.ones((8, 3)), np.random.default_rng(0))
        buffer.compute_returns_and_advantage(torch.ones(3), np.array([False, True, False]))
    np.testing.assert_allclose(ours.advantages, theirs.advantages, atol=1e-5)
    np.testing.assert_allclose(ours.returns, theirs.returns, atol=1e-5)


def test_long_steps_are_discounted_by_their_seconds():
    """With lambda 1 the return is the sum of rewards discounted by the time that passed before each."""
    rng = np.random.default_rng(1)
    durations = rng.uniform(0.5, 9.0, (8, 3))
    buffer = make_buffer(SemiMarkovBuffer, 0.95)
    buffer.gae_lambda = 1.0
    fill(buffer, durations, rng)
    buffer.episode_starts[:] = 0.0
    buffer.compute_returns_and_advantage(torch.full((3,), 2.0), np.zeros(3, bool))
    before = np.vstack([np.zeros(3), np.cumsum(durations, axis=0)])
    expected = (0.95 ** before[:-1] * buffer.rewards).sum(axis=0) + 0.95 ** before[-1] * 2.0
    np.testing.assert_allclose(buffer.returns[0], expected, rtol=1e-4)


def test_the_curriculum_grows():
    source = open_plans("procedural:3")
    plans = [source.load(source.ids[i]) for i in range(8)]
    curriculum = Curriculum(areas=(80.0, 140.0), shares=(0.25, 0.5))
    assert [curriculum.stage(share) for share in (0.0, 0.24, 0.25, 0.5, 1.0)] == [0, 0, 1, 2, 2]
    staged = StagedPlans(plans, curriculum)
    sizes = []
    for stage in range(3):
        staged.set_stage(stage)
        sizes.append(len(staged))
        assert all(staged.load(plan_id).area <= (80.0, 140.0, np.inf)[stage] for plan_id in staged.ids[1:])
    assert sizes == sorted(sizes)
    assert sizes[-1] == 8


def test_plans_are_drawn_from_the_split_only():
    for split in ("train", "validation"):
        plans = draw_plans(["procedural:0", "bundled"], split, 4)
        assert plans
        assert {split_of(plan.id) for plan in plans} == {split}


def test_larger_plans_are_drawn_where_asked_for():
    homes, offices = (
        draw_plans(["procedural:office:loops"], "train", 12, largest_area=area) for area in (300.0, 600.0)
    )
    assert max(plan.area for plan in homes) <= 300.0 < max(plan.area for plan in offices) <= 600.0


@pytest.mark.parametrize(
    "changes",
    [
        {"algo": "sac"},
        {"steps": -1},
        {"discount": 1.5},
        {"evaluate_every": -1},
        {"env": "explore"},
        {"promise": "most of it"},
    ],
)
def test_senseless_runs_are_refused(changes):
    with pytest.raises(ConfigError):
        dataclasses.replace(TINY, **changes)


def test_experts_choose_candidates_that_are_there():
    env = make_env(TINY, draw_plans(["procedural:0"], "train", 1))
    observation, _ = env.reset(seed=0)
    answers = [expert(env) for expert in EXPERTS.values()]
    for _ in range(4):
        for answer in answers:
            assert env.action_masks()[answer(observation)]
        observation, _, terminated, truncated, _ = env.step(0)
        if terminated or truncated:
            break


def test_imitation_alone_writes_a_policy_and_keeps_no_decisions(tmp_path):
    alone = dataclasses.replace(TINY, steps=0, imitation=ImitationConfig(decisions=12, rounds=2, epochs=1))
    model = train(alone, tmp_path)
    assert model.num_timesteps == 0
    assert (tmp_path / "policy.safetensors").is_file()
    assert not list(tmp_path.glob("choices_*"))


def test_interrupted_imitation_goes_on_after_the_last_round_that_was_collected(tmp_path, monkeypatch):
    settings = dataclasses.replace(TINY, steps=0, imitation=ImitationConfig(decisions=12, rounds=2, epochs=1))
    train(settings, tmp_path / "whole")
    collect, calls = imitation._collect, []

    def interrupted(*arguments, **keywords):
        calls.append(keywords["seed"])
        if calls == [0, 1]:
            raise KeyboardInterrupt
        return collect(*arguments, **keywords)

    monkeypatch.setattr(imitation, "_collect", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train(settings, tmp_path / "parts")
    train(settings, tmp_path / "parts")
    assert calls == [0, 1, 1]
    weights = [read_policy(tmp_path / name / "policy.safetensors").weights for name in ("whole", "parts")]
    for name, value in weights[0].items():
        np.testing.assert_array_equal(weights[1][name], value)


def test_a_run_is_saved_and_goes_on_where_it_stopped(tmp_path):
    half = dataclasses.replace(
        TINY, imitation=ImitationConfig(decisions=12), evaluate_every=100, evaluate_plans=1
    )
    model = train(half, tmp_path)
    assert model.num_timesteps == 24
    for name in ("config.json", "checkpoint.pt", "policy.safetensors", "policy.json", "validation.csv"):
        assert (tmp_path / name).is_file(), name
    assert list(tmp_path.glob("log/*/events.out.tfevents.*"))
    weights = read_policy(tmp_path / "policy.safetensors").weights
    again = train(half, tmp_path)  # nothing is left to do, and nothing is lost
    assert again.num_timesteps == 24
    for name, value in read_policy(tmp_path / "policy.safetensors").weights.items():
        np.testing.assert_array_equal(value, weights[name])
    assert again.policy.optimizer.state_dict()["state"]
    with pytest.raises(ConfigError, match="holds a run with seed = 0"):
        train(dataclasses.replace(half, seed=1), tmp_path)
    (tmp_path / "checkpoint.pt").write_bytes(b"not a checkpoint")
    with pytest.raises(InputFileError, match="checkpoint"):
        train(half, tmp_path)


def test_a_run_can_begin_with_other_weights(tmp_path):
    from slamgym.agents.pretrained_policy import PRETRAINED

    slow = dataclasses.replace(TINY, steps=12, ppo=dataclasses.replace(TINY.ppo, learning_rate=1e-12))
    train(dataclasses.replace(slow, start_from="pretrained"), tmp_path / "run")
    learned, pretrained = (
        read_policy(p).weights for p in (tmp_path / "run" / "policy.safetensors", PRETRAINED)
    )
    for name, value in pretrained.items():
        np.testing.assert_allclose(learned[name], value, atol=1e-6)
    coastal = dataclasses.replace(slow, start_from="pretrained", network=NetworkConfig(exposure_prior=-8.0))
    train(coastal, tmp_path / "coastal")
    leaning = read_policy(tmp_path / "coastal" / "policy.safetensors").weights["prior.weight"]
    moved = (leaning - pretrained["prior.weight"])[0]
    assert moved[CANDIDATE_FEATURES.index("exposure")] == pytest.approx(-8.0, abs=1e-5)
    assert np.count_nonzero(np.abs(moved) > 1e-5) == 1
    wide = dataclasses.replace(slow, start_from="pretrained", network=NetworkConfig(width=32))
    with pytest.raises(ConfigError, match="same sizes"):
        train(wide, tmp_path / "wide")
    with pytest.raises(InputFileError, match="can't be read"):
        train(dataclasses.replace(slow, start_from="nowhere.safetensors"), tmp_path / "nowhere")


def test_a_resumed_run_draws_other_plans_than_at_its_beginning(tmp_path, monkeypatch):
    seeds = []
    monkeypatch.setattr(
        train_module.MaskablePPO, "set_random_seed", lambda model, seed=None: seeds.append(seed)
    )
    train(dataclasses.replace(TINY, steps=12), tmp_path)
    assert seeds == [0]
    train(dataclasses.replace(TINY, steps=12), tmp_path)
    assert seeds == [0, 0, 12]


def test_plain_ppo_learns_on_frontiers_too(tmp_path):
    model = train(dataclasses.replace(TINY, algo="ppo", steps=12), tmp_path)
    assert model.num_timesteps == 12


def test_episodes_end_where_an_explorer_says_that_it_is_done(tmp_path):
    """Half of the environments are furnished, and what breaks the promise counts twice in validation."""
    run = dataclasses.replace(
        TINY, promise="98%:95%", furnished=0.5, evaluate_every=100, evaluate_plans=2, time_limit=20.0
    )
    model = train(run, tmp_path)
    loops = model.get_env().get_attr("loop_config")
    assert {str(loop.promise) for loop in loops} == {"98%:95%"}
    furniture = [config.clutter.furniture for config in model.get_env().get_attr("config")]
    assert furniture == [1.0, 0.0]
    last = read_validation(tmp_path)[-1]
    assert last["coverage"] < 0.98
    assert last["score"] == pytest.approx(2.0 * last["time"])

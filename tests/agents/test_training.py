"""Training: plans, a whole small run, and going on with it."""

import dataclasses

import numpy as np
import pytest

from slamgym.agents.plan_splits import draw_plans, split_of
from slamgym.agents.rl.learner import LearnerConfig, arguments_of
from slamgym.agents.rl.train_config import TrainConfig
from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from safetensors.torch import load_file  # noqa: E402
from stable_baselines3 import PPO  # noqa: E402

from slamgym.agents.pretrained_policy import read_policy  # noqa: E402
from slamgym.agents.rl.run import read_validation  # noqa: E402
from slamgym.agents.rl.train import train  # noqa: E402

TINY = TrainConfig(
    plan_count=2,
    steps=24,
    num_envs=4,
    copies=2,
    learner=LearnerConfig("ppo", {"n_steps": 6, "batch_size": 6, "n_epochs": 1}),
    evaluate_every=0,
    time_limit=40.0,
)


def test_plans_are_drawn_from_the_split_only():
    for split in ("train", "validation"):
        plans = draw_plans(["procedural:0", "bundled"], split, 4)
        assert plans
        assert {split_of(plan.id) for plan in plans} == {split}


def test_larger_plans_are_drawn_where_asked_for():
    homes, offices = (
        draw_plans(["procedural:office:loops"], "train", 12, largest_area=area)
        for area in (300.0, 600.0)
    )
    assert max(plan.area for plan in homes) <= 300.0 < max(plan.area for plan in offices) <= 600.0


@pytest.mark.parametrize(
    "changes",
    [
        {"algo": "trpo"},
        {"num_envs": 3},  # no multiple of the copies
        {"start": "nearest"},
        {"steps": -1},
        {"evaluate_every": -1},
        {"env": "explore"},
        {"promise": "98%:95%"},  # which an earlier version had
    ],
)
def test_senseless_runs_are_refused(changes):
    with pytest.raises(ConfigError):
        from_dict(TrainConfig, to_dict(TINY) | changes)


def test_a_run_is_saved_and_goes_on_where_it_stopped(tmp_path, capsys):
    half = dataclasses.replace(TINY, evaluate_every=100, evaluate_plans=1)
    model = train(half, tmp_path)
    done = model.num_timesteps
    assert done >= 24
    assert f"validation at decision {done}: time_95 " in capsys.readouterr().err
    for name in (
        "config.json",
        "checkpoint.safetensors",
        "policy.safetensors",
        "policy.json",
        "validation.csv",
    ):
        assert (tmp_path / name).is_file(), name
    assert list(tmp_path.glob("log/*/events.out.tfevents.*"))
    weights, _ = read_policy(tmp_path / "policy.safetensors")
    again = train(half, tmp_path)  # nothing is left to do, and nothing is lost
    assert again.num_timesteps == done
    for name, value in read_policy(tmp_path / "policy.safetensors")[0].items():
        np.testing.assert_array_equal(value, weights[name])
    assert again.policy.optimizer.state_dict()["state"]
    with pytest.raises(ConfigError, match=r"other settings \(seed was 0, now 1\); choose"):
        train(dataclasses.replace(half, seed=1), tmp_path)
    (tmp_path / "checkpoint.safetensors").write_bytes(b"not a checkpoint")
    with pytest.raises(InputFileError, match="checkpoint"):
        train(half, tmp_path)
    (tmp_path / "checkpoint.pt").touch()
    with pytest.raises(ConfigError, match="holds a run of an older version"):
        train(half, tmp_path)


def test_a_checkpoint_gives_the_learner_back_and_is_no_pickle(tmp_path):
    model = train(TINY, tmp_path)
    path = tmp_path / "checkpoint.safetensors"
    assert load_file(path)
    again = train(dataclasses.replace(TINY, workers=1), tmp_path)
    for name, state in model.get_parameters().items():
        torch.testing.assert_close(again.get_parameters()[name], state, rtol=0.0, atol=0.0)


def test_a_run_begins_with_the_weights_of_another(tmp_path):
    train(TINY, tmp_path / "first")
    weights = tmp_path / "first" / "policy.safetensors"
    dearer = dataclasses.replace(
        TINY, start=str(weights), steps=0, reward=dataclasses.replace(TINY.reward, missing=1.0)
    )
    train(dearer, tmp_path / "second")
    begun, _ = read_policy(tmp_path / "second" / "policy.safetensors")
    for name, value in read_policy(weights)[0].items():
        np.testing.assert_array_equal(begun[name], value)
    with pytest.raises(InputFileError, match="can't be read"):
        train(dataclasses.replace(dearer, start="none.safetensors"), tmp_path / "third")
    assert not (tmp_path / "third").exists()


def test_a_resumed_run_draws_other_plans_than_at_its_beginning(tmp_path, monkeypatch):
    seeds = []
    monkeypatch.setattr(PPO, "set_random_seed", lambda model, seed=None: seeds.append(seed))
    done = train(dataclasses.replace(TINY, steps=12), tmp_path).num_timesteps
    assert seeds == [0]
    train(dataclasses.replace(TINY, steps=12), tmp_path)
    assert seeds == [0, 0, done]


def test_hyperparameters_are_numbers_or_schedules():
    config = LearnerConfig("ppo", {"learning_rate": "lin_1.0", "clip_range": "0.5"})
    arguments = arguments_of(config)
    assert arguments["learning_rate"](0.5) == 0.5
    assert arguments["clip_range"] == 0.5
    for wrong in ("fast", "lin_fast"):
        with pytest.raises(ConfigError, match="is no number"):
            arguments_of(LearnerConfig("ppo", {"learning_rate": wrong}))


@pytest.mark.parametrize("algorithm", ["a2c", "trpo"])
def test_other_algorithms_learn_too(tmp_path, algorithm):
    learner = TINY.learner.changed(algorithm, {"n_steps": 6})
    train(dataclasses.replace(TINY, learner=learner, time_limit=20.0), tmp_path)
    assert (tmp_path / "policy.safetensors").is_file()


def test_half_of_the_environments_are_furnished(tmp_path):
    run = dataclasses.replace(
        TINY, furnished=0.5, evaluate_every=100, evaluate_plans=2, time_limit=20.0
    )
    model = train(run, tmp_path)
    furniture = [config.clutter.furniture for config in model.get_env().get_attr("config")]
    assert furniture == [1.0, 1.0, 0.0, 0.0]  # copies have the same
    last = read_validation(tmp_path)[-1]
    assert last["score"] == last["time_done"]


def test_a_start_that_fails_leaves_no_folder_and_another_kind_of_run_is_said(tmp_path):
    with pytest.raises(InputFileError, match="no such file"):
        train(dataclasses.replace(TINY, plans=(str(tmp_path / "typo.tar.gz"),)), tmp_path / "run")
    assert not (tmp_path / "run").exists()
    (tmp_path / "config.json").write_text('{"evaluate_seconds": 90.0}')
    with pytest.raises(InputFileError, match=r"holds no such training \(unknown .* another folder"):
        train(TINY, tmp_path)

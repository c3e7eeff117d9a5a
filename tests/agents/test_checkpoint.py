"""Checkpoints hold all that is learned, whatever the algorithm keeps it in."""

from types import SimpleNamespace

import pytest

from slamgym.core.errors import InputFileError

torch = pytest.importorskip("torch")

from slamgym.agents.rl.checkpoint import load_checkpoint, save_checkpoint  # noqa: E402


def learner(value):
    """What a checkpoint asks of SAC: a network, an optimiser, and the logarithm of the entropy's weight."""
    policy = torch.nn.Linear(2, 1)
    torch.nn.init.constant_(policy.weight, value)
    weight = torch.full((1,), value, requires_grad=True)
    return SimpleNamespace(
        policy=policy,
        actor=SimpleNamespace(optimizer=torch.optim.Adam(policy.parameters(), lr=value)),
        log_ent_coef=weight,
        num_timesteps=int(10 * value),
        _n_updates=3,
        get_vec_normalize_env=lambda: None,
        _get_torch_save_params=lambda: (["policy", "actor.optimizer"], ["log_ent_coef"]),
    )


def test_networks_optimisers_and_single_numbers_come_back(tmp_path):
    save_checkpoint(tmp_path, learner(0.5))
    other = learner(0.25)
    weight = other.log_ent_coef
    load_checkpoint(tmp_path, other)
    assert other.num_timesteps == 5
    assert other.log_ent_coef is weight  # its optimiser goes on with this very tensor
    assert float(weight.detach()) == 0.5
    assert float(other.policy.weight.detach()[0, 0]) == 0.5
    assert other.actor.optimizer.param_groups[0]["lr"] == 0.5


def test_a_checkpoint_without_a_number_that_is_learned_is_refused(tmp_path):
    older = learner(0.5)
    older._get_torch_save_params = lambda: (["policy", "actor.optimizer"], [])
    save_checkpoint(tmp_path, older)
    with pytest.raises(InputFileError, match="log_ent_coef"):
        load_checkpoint(tmp_path, learner(0.25))

"""The scoring network, its numpy twin, and weights on disk."""

import contextlib
import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.agents.pretrained_policy import read_policy, weight_shapes, write_policy
from slamgym.agents.scoring import FrontierScorer
from slamgym.core.errors import InputFileError
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, LIMIT

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
from slamgym.agents.rl.policy import FIRST_DONE, FrontierCritic, FrontierNetwork  # noqa: E402


def make_network(seed=0):
    torch.manual_seed(seed)
    network = FrontierNetwork()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    return network.eval()


def weights_of(network):
    return {name: value.detach().numpy() for name, value in network.state_dict().items()}


def make_observation(seed, count, rows=16):
    rng = np.random.default_rng(seed)
    mask = np.zeros(rows, np.float32)
    mask[:count] = 1.0
    lengths = rng.uniform(0.0, 2.0, (rows + 1, rows + 1)).astype(np.float32)
    lengths[rng.random(lengths.shape) < 0.1] = LIMIT  # no path
    return {
        "frontiers": rng.normal(size=(rows, len(CANDIDATE_FEATURES))).astype(np.float32)
        * mask[:, None],
        "lengths": lengths,
        "globals": rng.normal(size=len(GLOBAL_FEATURES)).astype(np.float32),
        "mask": mask,
    }


def batch_of(*observations):
    return {
        key: torch.as_tensor(np.stack([o[key] for o in observations])) for key in observations[0]
    }


def torch_decision(network, observation):
    with torch.no_grad():
        scores, done = network(batch_of(observation))
    return scores[0].numpy(), float(done[0])


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), count=st.integers(1, 16))
def test_numpy_and_torch_agree(seed, count):
    network = make_network()
    observation = make_observation(seed, count)
    decision = FrontierScorer(weights_of(network)).decide(observation)
    scores, done = torch_decision(network, observation)
    # float32 sums of some hundred terms in another order, up to 20, which cancel
    np.testing.assert_allclose(decision.scores, scores[:count], rtol=1e-4, atol=1e-3)
    assert decision.done == pytest.approx(done, abs=1e-3)


def test_frontiers_may_come_in_any_order_and_number():
    """Scores are equivariant, and rows that the mask hides change nothing, whatever K is, also in a batch."""
    network = make_network()
    wide = make_observation(0, 5, rows=16)
    narrow = {
        "frontiers": wide["frontiers"][:7],
        "lengths": wide["lengths"][:8, :8],
        "globals": wide["globals"],
        "mask": wide["mask"][:7],
    }
    order = np.random.default_rng(0).permutation(5)
    turned = {key: value.copy() for key, value in wide.items()}
    turned["frontiers"][:5] = wide["frontiers"][order]
    places = np.append(0, 1 + order)
    turned["lengths"][:6, :6] = wide["lengths"][np.ix_(places, places)]
    hidden = {key: value.copy() for key, value in wide.items()}
    hidden["frontiers"][5:] = 7.0  # behind the mask
    scores, done = torch_decision(network, wide)
    np.testing.assert_allclose(torch_decision(network, narrow)[0][:5], scores[:5], atol=1e-4)
    np.testing.assert_allclose(torch_decision(network, turned)[0][:5], scores[order], atol=1e-4)
    assert torch_decision(network, turned)[1] == pytest.approx(done, abs=1e-4)
    np.testing.assert_allclose(torch_decision(network, hidden)[0][:5], scores[:5], atol=1e-4)
    with torch.no_grad():
        both = network(batch_of(wide, make_observation(1, 12)))[0][0].numpy()
    np.testing.assert_allclose(both[:5], scores[:5], atol=1e-4)


def test_lengths_between_frontiers_change_what_is_chosen():
    """Two frontiers with the same features differ by the paths from them to a third alone."""
    network = make_network()
    observation = make_observation(2, 3)
    observation["frontiers"][1] = observation["frontiers"][0]
    observation["lengths"][:] = 0.5
    scores, _ = torch_decision(network, observation)
    assert scores[0] == pytest.approx(scores[1], abs=1e-5)
    observation["lengths"][1, 3] = observation["lengths"][3, 1] = 2.0
    scores, _ = torch_decision(network, observation)
    assert abs(scores[0] - scores[1]) > 1e-3


def test_an_untrained_network_chooses_at_random_and_seldom_says_done():
    network = FrontierNetwork()
    for seed in range(5):
        scores, done = torch_decision(network, make_observation(seed, 9))
        chances = np.exp(scores[:9]) / np.exp(scores[:9]).sum()
        np.testing.assert_allclose(chances, 1.0 / 9.0, atol=0.02)
        assert done == pytest.approx(FIRST_DONE, abs=0.3)


def test_a_network_that_starts_from_the_tour_chooses_as_it_does():
    network = FrontierNetwork()
    network.follow_the_tour()
    observation = make_observation(3, 9)
    detours = observation["frontiers"][:9, CANDIDATE_FEATURES.index("tour_detour")]
    assert int(torch_decision(network, observation)[0].argmax()) == int(detours.argmin())


def test_without_any_frontier_nothing_is_nan():
    scores, done = torch_decision(make_network(), make_observation(0, 0))
    assert np.isfinite(scores).all()
    assert np.isfinite(done)


def test_the_critic_sees_the_truth_and_the_actor_does_not():
    torch.manual_seed(0)
    critic = FrontierCritic(2)
    torch.nn.init.normal_(critic.out.weight)
    values = []
    decisions = []
    for truth in (0.0, 1.0):
        batch = batch_of({**make_observation(0, 4), "truth": np.full(2, truth, np.float32)})
        values.append(critic(batch).detach().item())
        decisions.append(make_network()(batch)[0][0, 0].item())
    assert values[0] != values[1]
    assert decisions[0] == decisions[1]


def test_the_file_s_shapes_are_those_of_the_network():
    assert {
        name: value.shape for name, value in weights_of(make_network()).items()
    } == weight_shapes()


@pytest.fixture
def policy_path(tmp_path):
    path = tmp_path / "policy.safetensors"
    write_policy(path, weights_of(make_network()), {"steps": 7})
    return path


def test_weights_come_back_as_they_were_written(policy_path):
    weights, about = read_policy(policy_path)
    assert about["steps"] == 7
    for name, value in weights_of(make_network()).items():
        np.testing.assert_array_equal(weights[name], value)
    assert json.loads(policy_path.with_suffix(".json").read_text())["about"]["steps"] == 7


def test_the_safetensors_package_reads_the_file_too(policy_path):
    numpy_reader = pytest.importorskip("safetensors.numpy")
    loaded = numpy_reader.load_file(policy_path)
    for name, value in weights_of(make_network()).items():
        np.testing.assert_array_equal(loaded[name], value)


@pytest.mark.parametrize("share", [0.0, 0.0001, 0.02, 0.5, 0.999])
def test_a_truncated_file_gives_one_error_that_names_it(policy_path, share):
    content = policy_path.read_bytes()
    policy_path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputFileError, match=policy_path.name):
        read_policy(policy_path)


@settings(max_examples=60)
@given(position=st.integers(0, 3000), value=st.integers(0, 255))
def test_a_flipped_byte_is_read_or_refused_but_never_crashes(tmp_path_factory, position, value):
    path = tmp_path_factory.getbasetemp() / "flipped.safetensors"
    if not path.exists():
        write_policy(path, weights_of(make_network()), {})
    content = bytearray(path.read_bytes())
    content[position] = value
    broken = path.with_name("broken.safetensors")
    broken.write_bytes(content)
    with contextlib.suppress(InputFileError):  # any other error fails the test
        read_policy(broken)


def rewrite(path, change):
    """Change the configuration in a file's header."""
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    configuration = json.loads(header["__metadata__"]["slamgym"])
    change(configuration)
    header["__metadata__"]["slamgym"] = json.dumps(configuration)
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + content[8 + length :])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda c: c["space"].update(feature_version=99),
            "another observation space .feature_version 99",
        ),
        (
            lambda c: c["space"]["candidate_features"].pop(),
            "another observation space .candidate_features",
        ),
        (lambda c: c["space"].update(env="slamgym/Explore-v4"), "another observation space .env"),
        (lambda c: c["network"].update(width=32), "another observation space .width 32"),
        (lambda c: c["network"].update(blocks=3), "another observation space .blocks 3"),
        (lambda c: c.pop("space"), "no frontier policy"),
    ],
)
def test_weights_for_something_else_are_refused(policy_path, change, message):
    rewrite(policy_path, change)
    with pytest.raises(InputFileError, match=message) as caught:
        read_policy(policy_path)
    assert policy_path.name in str(caught.value)


def test_a_pickle_is_not_loaded(tmp_path):
    path = tmp_path / "model.zip"
    torch.save({"a": 1}, path)
    with pytest.raises(InputFileError, match="safetensors"):
        read_policy(path)

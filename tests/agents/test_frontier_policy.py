"""The scoring network, its numpy twin, and weights on disk."""

import contextlib
import json
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.agents.pretrained_policy import read_policy, write_policy
from slamgym.agents.scoring import FrontierScorer
from slamgym.core.errors import InputFileError
from slamgym.envs.frontier_features import CANDIDATE_FEATURES, CROP_PX, GLOBAL_FEATURES

torch = pytest.importorskip("torch")
from slamgym.agents.rl.policy import FrontierNetwork  # noqa: E402 - needs torch


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
    return {
        "candidates": rng.normal(size=(rows, len(CANDIDATE_FEATURES))).astype(np.float32)
        * mask[:, None],
        "crops": rng.random((rows, 2, CROP_PX, CROP_PX)).astype(np.float32),
        "globals": rng.normal(size=len(GLOBAL_FEATURES)).astype(np.float32),
        "mask": mask,
    }


def torch_scores(network, observation):
    batch = {key: torch.as_tensor(value)[None] for key, value in observation.items()}
    with torch.no_grad():
        scores, values = network(batch)
    return scores[0].numpy(), float(values[0])


@settings(max_examples=25)
@given(seed=st.integers(0, 1000), count=st.integers(1, 16))
def test_numpy_and_torch_agree(seed, count):
    network = make_network()
    observation = make_observation(seed, count)
    scorer = FrontierScorer(weights_of(network))
    # float32 sums of some hundred terms in another order, up to 20, which cancel: 2e-4 with AVX-512
    np.testing.assert_allclose(
        scorer.scores(observation),
        torch_scores(network, observation)[0][:count],
        rtol=1e-4,
        atol=1e-3,
    )


def test_candidates_may_come_in_any_order_and_number():
    """Scores are equivariant, and rows that the mask hides change nothing, whatever K is."""
    network = make_network()
    wide, narrow = make_observation(0, 5, rows=16), make_observation(0, 5, rows=16)
    narrow = {key: value[:7] if key != "globals" else value for key, value in narrow.items()}
    order = np.random.default_rng(0).permutation(5)
    turned = {key: value.copy() for key, value in wide.items()}
    for key in ("candidates", "crops"):
        turned[key][:5] = wide[key][order]
        wide[key][5:] = 7.0  # behind the mask
    scores, value = torch_scores(network, wide)
    np.testing.assert_allclose(torch_scores(network, narrow)[0][:5], scores[:5], atol=1e-4)
    np.testing.assert_allclose(torch_scores(network, turned)[0][:5], scores[:5][order], atol=1e-4)
    assert torch_scores(network, narrow)[1] == pytest.approx(value, abs=1e-4)


def test_an_untrained_network_begins_with_the_shortest_tour():
    network = FrontierNetwork()
    observation = make_observation(3, 9)
    detours = observation["candidates"][:9, CANDIDATE_FEATURES.index("tour_detour")]
    assert int(torch_scores(network, observation)[0].argmax()) == int(detours.argmin())


def test_without_any_candidate_nothing_is_nan():
    scores, value = torch_scores(make_network(), make_observation(0, 0))
    assert np.isfinite(scores).all()
    assert np.isfinite(value)


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
        (lambda c: c["space"].update(env="slamgym/Explore-v2"), "another observation space .env"),
        (lambda c: c["network"].update(width=32), "another observation space .width 32"),
        (
            lambda c: c["network"].update(foresight=True),
            "another observation space .foresight True",
        ),
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

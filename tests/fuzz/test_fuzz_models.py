"""Whatever lies in the files of translators and explorers, reading them gives a value or an error to fix."""

import functools
import importlib.util
import json
import struct

import numpy as np
import pytest
from fuzz.mutations import (
    cases,
    must_read_or_refuse,
    mutated_bytes,
    mutated_json,
    mutated_lines,
    mutated_value,
)
from hypothesis import given
from hypothesis import strategies as st

from slamgym.agents.evaluation.evaluate import TrialLog
from slamgym.agents.evaluation.trial import Trial
from slamgym.agents.hidden_floor import HIDDEN_FLOOR, HiddenFloor
from slamgym.core.config import from_dict, to_dict
from slamgym.core.pictures import encode_png
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import load_pairs
from slamgym.gan.presets import TRANSLATOR_PRESETS

TRIAL = Trial(
    explorer="nearest", plan="hall", seed=1, settings="0" * 12, area=20.0, rooms=2, time_limit=300.0,
    finished=True, time=60.0, path=20.0, coverage=0.99, time_to={"0.95": 50.0, "0.99": None},
    path_to={"0.95": 15.0, "0.99": None}, mean_coverage=0.9, collisions=0, map_error=0.02, ate=0.05, decisions=3,
    decision_cpu=0.01, cpu=2.0,
    curve={"time": [0.0, 60.0], "path": [0.0, 20.0], "coverage": [0.1, 0.99]},
)  # fmt: skip


def _split(content):
    """Header and data of a safetensors file."""
    (length,) = struct.unpack("<Q", content[:8])
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def _joined(header, body):
    return struct.pack("<Q", len(header)) + header + body


@st.composite
def damaged_weights(draw, path, inner):
    """A safetensors file with damage in its header, in the JSON texts inside the header, or in its bytes."""
    header, body = _split(path.read_bytes())
    kind = draw(st.sampled_from(["bytes", "header", "inner", "inner"]))
    if kind == "inner":
        metadata = header["__metadata__"]
        name = draw(st.sampled_from(inner))
        text = draw(mutated_json([json.loads(metadata[name])])).decode(errors="replace")
        header = {**header, "__metadata__": {**metadata, name: text}}
    elif kind == "header":
        # A few tensors are enough to choose from.
        few = {name: header[name] for name in list(header)[:4]}
        changed = draw(mutated_value([few]))
        header = {**header, **changed} if isinstance(changed, dict) else changed
    content = _joined(json.dumps(header).encode(), body)
    return draw(mutated_bytes([content])) if kind == "bytes" else content


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fuzzed")


@cases(100)
@given(damaged_weights(HIDDEN_FLOOR, ["slamgym"]))
def test_policies(folder, content):
    path = folder / "policy.safetensors"
    path.write_bytes(content)
    must_read_or_refuse(HiddenFloor.read, path)


@cases(100)
@given(mutated_lines([to_dict(TRIAL), {**to_dict(TRIAL), "seed": 2}]))
def test_trials(folder, content):
    path = folder / "trials.jsonl"
    path.write_bytes(content)
    log = must_read_or_refuse(TrialLog, path, Trial)
    for trial in log.trials.values() if log else ():
        must_read_or_refuse(lambda trial=trial: trial.coverage_curve.final)


@cases(100)
@given(
    st.sampled_from(sorted(TRANSLATOR_PRESETS)).flatmap(
        lambda n: mutated_value([to_dict(TRANSLATOR_PRESETS[n])])
    )
)
def test_settings_of_translators(value):
    config = must_read_or_refuse(from_dict, TranslatorTrainingConfig, value, "config.json")
    assert config is None or config.stages[-1].resolution == config.translator.output_size


@cases(100)
@given(
    mutated_lines(
        [{"name": "x", "plan_id": "hall", "group": "hall", "metres_per_px": 0.1, "split": "train"}]
    )
)
def test_manifests_of_training_images(folder, content):
    for side in ("A", "B"):
        (folder / "train" / side).mkdir(parents=True, exist_ok=True)
        (folder / "train" / side / "x.png").write_bytes(encode_png(np.zeros((8, 8), np.uint8)))
    (folder / "manifest.jsonl").write_bytes(content)
    pairs = must_read_or_refuse(load_pairs, folder, "train", 8)
    if pairs is not None:
        pairs.scale_percentiles()
        pairs.split(0.5)


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="needs torch")
class TestWithTorch:
    """Readers that need torch."""

    @cases(100)
    @given(data=st.data())
    def test_translators(self, folder, data):
        from slamgym.gan.weights import PRETRAINED_FOLDER, load_weights

        path = folder / "weights.safetensors"
        path.write_bytes(
            data.draw(
                damaged_weights(PRETRAINED_FOLDER / "slam2cad.safetensors", ["config", "card"])
            )
        )
        must_read_or_refuse(load_weights, path)

    @cases(100)
    @given(data=st.data())
    def test_states_of_trainings(self, folder, data):
        import torch
        from safetensors.torch import save

        from slamgym.gan.training.learner import STATE_FORMAT, load_training_state

        facts = {
            "identity": {"preset": "x"},
            "sampler": {"position": 1},
            "spans": [[1, 2]],
            "steps_done": 3,
        }
        whole, path = folder / "whole.safetensors", folder / "state.safetensors"
        header = {"format": STATE_FORMAT, "facts": json.dumps(facts)}
        whole.write_bytes(save({"torch.cpu": torch.get_rng_state()}, header))
        path.write_bytes(data.draw(damaged_weights(whole, ["facts"])))
        state = must_read_or_refuse(load_training_state, path)
        assert state is None or isinstance(state[1], dict)

    @cases(100)
    @given(data=st.data())
    def test_cached_alignments(self, folder, data):
        from safetensors.numpy import save

        from slamgym.gan.registration import _cached

        whole, path = folder / "cache.safetensors", folder / "damaged.safetensors"
        whole.write_bytes(save({"0": np.zeros((2, 4))}, {"x": "{}"}))
        path.write_bytes(data.draw(damaged_weights(whole, ["x"])))
        found = _cached(path, "0", 2)
        assert found is None or found.shape == (2, 4)

    @cases(100)
    @given(data=st.data())
    def test_settings_of_runs_of_explorers(self, folder, data):
        pytest.importorskip("stable_baselines3")
        from slamgym.agents.rl.run import CONFIG, read_run
        from slamgym.agents.rl.train_config import TrainConfig

        (folder / CONFIG).write_bytes(
            data.draw(mutated_json([{"version": "0.1.0", **to_dict(TrainConfig())}]))
        )
        must_read_or_refuse(functools.partial(read_run, TrainConfig), folder)

"""Weights on disk: they come back, and what isn't weights is refused with one clear error."""

import dataclasses
import json
import pickle

import pytest
import torch
from safetensors.torch import save_file

from slamgym.core.config import from_dict, to_dict
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.gan.config import GeneratorConfig, TranslatorConfig
from slamgym.gan.networks.factory import build_generator
from slamgym.gan.weights import ModelCard, load_weights, pretrained_names, save_translator

TINY = TranslatorConfig(
    input_size=16,
    output_size=16,
    input_encoding="grey",
    output_encoding="layers",
    generator=GeneratorConfig("residual", width=8, depth=2),
)
CARD = ModelCard(preset="tiny", pairs=3, figures={"mse": 0.25}, command="slamgym gan train")


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "tiny.safetensors"
    generator = build_generator(TINY, seed=4)
    save_translator(path, generator, TINY, CARD)
    return path, generator


def test_weights_come_back_in_half_precision(saved):
    path, generator = saved
    weights = load_weights(path)
    assert weights.config == TINY
    assert weights.card == CARD
    x = torch.randn(1, 1, 16, 16, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        expected, found = generator.eval()(x).image, weights.generator(x).image
    assert torch.allclose(expected, found, atol=0.02)  # 11 bits a weight through a dozen layers
    assert not any(p.requires_grad for p in weights.generator.parameters())


def test_the_model_card_and_the_settings_lie_beside(saved):
    path, _ = saved
    card = path.with_suffix(".md").read_text()
    assert "SLAM maps to CAD maps" in card
    assert "| mse    |  0.25 |" in card
    assert json.loads(path.with_suffix(".json").read_text())["config"]["input_size"] == 16


def test_weights_of_the_other_direction_are_refused(saved):
    with pytest.raises(
        ConfigError, match="translate SLAM maps to CAD maps, not CAD maps to SLAM maps"
    ):
        load_weights(saved[0], direction="cad2slam")


class Malicious:
    def __reduce__(self):
        return (pytest.fail, ("code in a weights file was run",))


def test_pickles_are_refused_unread(tmp_path):
    plain, archive = tmp_path / "plain.safetensors", tmp_path / "torch.safetensors"
    plain.write_bytes(pickle.dumps(Malicious()))
    torch.save({"weight": torch.zeros(1), "trap": Malicious()}, archive)
    for path in (plain, archive):
        with pytest.raises(InputFileError, match="can run code when it is read"):
            load_weights(path)


def rewritten(path, change_config=None, change_tensors=None, header=None):
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
        found = dict(file.metadata())
    if change_config is not None:
        found["config"] = json.dumps(change_config(json.loads(found["config"])))
    if change_tensors is not None:
        tensors = change_tensors(tensors)
    save_file(tensors, path, metadata=found if header is None else header)
    return path


def residual(width):
    return {"kind": "residual", "width": width, "depth": 2}


def without_first(tensors):
    return dict(list(tensors.items())[1:])


def with_nan(tensors):
    nan = float("nan")
    return {k: torch.full_like(v, nan) if v.is_floating_point() else v for k, v in tensors.items()}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"header": {"format": "pt"}}, "not of a slamgym translator"),
        ({"header": {"format": "slamgym-translator-1"}}, "of another version of slamgym .*train them again"),
        ({"change_tensors": without_first}, "tensors of another network"),
        ({"change_tensors": with_nan}, "NaN"),
        ({"change_config": lambda c: c | {"colour": 1}}, "unknown setting 'colour'"),
        ({"change_config": lambda c: c | {"input_size": 17}}, "power of two"),
        ({"change_config": lambda c: c | {"generator": residual(16)}}, "another network"),
        ({"change_config": lambda c: c | {"generator": residual(400_000)}}, "unreasonable"),
        ({"change_config": lambda c: c | {"generator": residual(8) | {"fold": 4}}}, "unknown setting 'fold'"),
        ({"change_config": lambda c: [1]}, "settings that can't be used"),
    ],
)  # fmt: skip
def test_files_that_do_not_fit_are_refused(saved, changes, message):
    with pytest.raises(InputFileError, match=message):
        load_weights(rewritten(saved[0], **changes))


@pytest.mark.parametrize("content", [b"", b"garbage", b"\xff" * 64])
def test_damaged_files_are_refused(tmp_path, content):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match="damaged or not a safetensors file"):
        load_weights(path)


def test_a_cut_file_is_refused(saved):
    saved[0].write_bytes(saved[0].read_bytes()[:-1000])
    with pytest.raises(InputFileError, match="damaged"):
        load_weights(saved[0])


def test_unknown_names_and_missing_files(tmp_path):
    with pytest.raises(ConfigError, match="no weights are called 'slam2cadd'"):
        load_weights("slam2cadd")
    with pytest.raises(InputFileError, match="doesn't exist"):
        load_weights(tmp_path / "absent.safetensors")


def test_a_file_that_cannot_be_written_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="can't be written"):
        save_translator(tmp_path / "file" / "w.safetensors", build_generator(TINY), TINY, CARD)


@pytest.mark.parametrize("name", pretrained_names())
def test_pretrained_weights_load_and_are_small(name):
    from slamgym.gan.weights import PRETRAINED_FOLDER

    assert (PRETRAINED_FOLDER / f"{name}.safetensors").stat().st_size <= 15_000_000
    weights = load_weights(name)
    stored = json.loads((PRETRAINED_FOLDER / f"{name}.json").read_text())["config"]
    assert from_dict(TranslatorConfig, stored) == weights.config
    assert (PRETRAINED_FOLDER / f"{name}.md").read_text().startswith(f"# {name}\n")


def test_settings_survive_their_json_form():
    config = dataclasses.replace(TINY, metres_per_px=(0.03, 0.05, 0.07))
    assert from_dict(TranslatorConfig, json.loads(json.dumps(to_dict(config)))) == config

"""What ships is listed with its SHA-256, and compared with it when it is loaded."""

import shutil
import subprocess
import sys

import pytest
from source_tree import FOLDERS

from slamgym.agents.hidden_floor import HIDDEN_FLOOR, HiddenFloor
from slamgym.cad import open_plans
from slamgym.cad.sources import BUNDLED
from slamgym.core import provenance
from slamgym.core.errors import SlamgymError
from slamgym.core.provenance import check_origin, current_checksums, read_checksums
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel

SHIPPED = {
    "policy": (HIDDEN_FLOOR, HiddenFloor.read),
    "completeness": (PRETRAINED_MODEL, CompletenessModel.read),
    "plan": (BUNDLED / "home_000000.json", lambda: open_plans("bundled").load("home_000000")),
}


def test_the_list_is_up_to_date():
    assert read_checksums() == current_checksums(), "run python -m slamgym.core.provenance"


def test_everything_that_is_loaded_from_the_package_is_listed():
    suffixes = {".safetensors", ".npz"}
    found = {
        "/".join([*package.split(".")[1:], path.relative_to(folder).as_posix()])
        for package, folder in FOLDERS.items()
        for path in folder.rglob("*")
        if path.suffix in suffixes
    }
    assert {
        "agents/pretrained/frontier_policy.safetensors",
        "agents/pretrained/hidden_floor.safetensors",
        "gan/pretrained/model32.safetensors",
    } <= found
    assert found <= read_checksums().keys()


@pytest.mark.parametrize("what", SHIPPED)
def test_a_file_that_differs_is_refused_with_one_sentence(what, monkeypatch, tmp_path):
    path, load = SHIPPED[what]
    load()
    monkeypatch.setattr(
        provenance, "read_checksums", lambda: dict.fromkeys(current_checksums(), "0" * 64)
    )
    with pytest.raises(
        SlamgymError, match=r"is not the file that came with slamgym .*install slamgym again"
    ):
        load()
    monkeypatch.setattr(provenance, "read_checksums", dict)
    with pytest.raises(SlamgymError, match=r"is not listed in pretrained\.sha256"):
        load()
    check_origin(shutil.copy(path, tmp_path))  # files from elsewhere are the user's own


def test_translators_are_compared_too(monkeypatch):
    pytest.importorskip("torch")
    from slamgym.gan.weights import load_weights, pretrained_names

    for name in pretrained_names():
        load_weights(name)
    monkeypatch.setattr(provenance, "read_checksums", dict)
    with pytest.raises(SlamgymError, match="is not listed"):
        load_weights("model32")


def test_a_policy_is_read_without_torch():
    code = (
        "import sys; from slamgym.agents.hidden_floor import HiddenFloor; HiddenFloor.read(); "
        "assert 'safetensors' in sys.modules and not {'torch', 'cv2'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

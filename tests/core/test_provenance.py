"""What ships is listed with its SHA-256, and compared with it when it is loaded."""

import shutil
import subprocess
import sys

import pytest

from slamgym.agents.pretrained_policy import PRETRAINED, read_policy
from slamgym.cad import open_plans
from slamgym.cad.sources import BUNDLED
from slamgym.core import provenance
from slamgym.core.errors import SlamgymError
from slamgym.core.provenance import PACKAGE, check_origin, current_checksums, read_checksums
from slamgym.dataset.curate.completeness_model import PRETRAINED_MODEL, CompletenessModel

SHIPPED = {
    "policy": (PRETRAINED, lambda: read_policy(PRETRAINED)),
    "completeness": (PRETRAINED_MODEL, CompletenessModel.read),
    "plan": (BUNDLED / "home_000000.json", lambda: open_plans("bundled").load("home_000000")),
}


def test_the_list_is_up_to_date():
    assert read_checksums() == current_checksums(), "run python -m slamgym.core.provenance"


def test_everything_that_is_loaded_from_the_package_is_listed():
    suffixes = {".safetensors", ".npz"}
    found = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*") if path.suffix in suffixes}
    found |= {f"{link}/pretrained/{path.name}" for link in ("agents", "gan") for path in
              (PACKAGE / link / "pretrained").iterdir() if path.suffix in suffixes}  # fmt: skip
    assert found <= read_checksums().keys()


@pytest.mark.parametrize("what", SHIPPED)
def test_a_file_that_differs_is_refused_with_one_sentence(what, monkeypatch, tmp_path):
    path, load = SHIPPED[what]
    load()
    name = path.relative_to(PACKAGE).as_posix()
    listed = read_checksums()
    monkeypatch.setattr(provenance, "read_checksums", lambda: {**listed, name: "0" * 64})
    with pytest.raises(SlamgymError, match=r"is not the file that came with slamgym .*install slamgym again"):
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
        "import sys; from slamgym.agents.pretrained_policy import read_policy; read_policy(); "
        "assert 'safetensors' in sys.modules and not {'torch', 'cv2'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

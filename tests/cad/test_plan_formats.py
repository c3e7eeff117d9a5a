"""The table of formats is what the docs say and what errors name."""

import inspect
import pkgutil
from pathlib import Path

import pytest

from slamgym.cad import open_plans
from slamgym.cad.plan_formats import PLAN_FORMATS, PlanOptions, plan_format
from slamgym.core.errors import ConfigError, InputFileError, PlanError

DOCS = Path(__file__).parents[2] / "docs" / "drawing" / "inputs.md"


@pytest.mark.parametrize("row", PLAN_FORMATS, ids=lambda row: row.suffixes[0])
def test_every_format_has_an_opener_and_stands_in_the_docs(row):
    opener = pkgutil.resolve_name(row.opener)
    assert list(inspect.signature(opener).parameters) == ["path", "options"]
    suffixes = ", ".join(f"`{suffix}`" for suffix in row.suffixes)
    assert f"| {suffixes} | {row.content} |\n" in DOCS.read_text()


def test_no_suffix_is_of_two_formats():
    for row in PLAN_FORMATS:
        assert all(plan_format(f"A{suffix.upper()}") is row for suffix in row.suffixes)
    assert plan_format("plan.dwg") is None


def test_a_file_of_no_known_format_is_refused_with_all_that_are(tmp_path):
    (tmp_path / "plan.dwg").write_bytes(b"")
    with pytest.raises(InputFileError) as refused:
        open_plans(tmp_path / "plan.dwg")
    assert all(row.name in str(refused.value) for row in PLAN_FORMATS)


def test_a_scale_stands_behind_pictures_and_drawings_alone(tmp_path):
    for name in ("plan.json@0.05", "plan.json"):
        (tmp_path / name).write_text("{")
    with pytest.raises(InputFileError, match="is no known kind"):
        open_plans(f"{tmp_path}/plan.json@0.05")
    with pytest.raises(ConfigError, match="metres per pixel or unit"):
        open_plans(f"{tmp_path}/plan.dxf@much")


def test_an_archive_of_which_no_plan_is_wanted_is_empty(tmp_path):
    import tarfile

    with tarfile.open(tmp_path / "plans.tar", "w") as archive:
        (tmp_path / "a.json").write_text("{")
        archive.add(tmp_path / "a.json", "a.json")
    row = plan_format("plans.tar")
    assert row.open(tmp_path / "plans.tar", PlanOptions()).ids == ["a"]
    assert row.open(tmp_path / "plans.tar", PlanOptions(wanted=frozenset())).ids == []
    with pytest.raises(PlanError):
        row.open(tmp_path / "plans.tar", PlanOptions()).load("a")

"""Several sources of plans as one."""

import pickle

import pytest
from shapely import box

from slamgym.cad import (
    FloorPlan,
    check_plan,
    open_plan_mix,
    open_plans,
    plan_groups,
    write_houseexpo,
)
from slamgym.core.errors import ConfigError, InputFileError


@pytest.fixture
def folders(tmp_path):
    """Two folders with a plan of the same name in both."""
    for folder, names in (("one", "ab"), ("two", "bc")):
        for number, name in enumerate(names):
            plan = FloorPlan(name, box(0, 0, 3 + number, 4))
            write_houseexpo(tmp_path / folder / f"{name}.json", plan)
    return [str(tmp_path / "one"), str(tmp_path / "two")]


def test_plans_of_one_name_stay_apart(folders):
    source = open_plan_mix(folders)
    assert list(source.ids) == ["a", "b", "b~2", "c"]
    assert source.load("b").area == pytest.approx(16.0)
    assert source.load("b~2").area == pytest.approx(12.0)
    assert all(source.load(plan_id).id == plan_id for plan_id in source.ids)
    assert [list(group.ids) for group in plan_groups(source)] == [["a", "b"], ["b~2", "c"]]


def test_weights_and_commas(folders):
    groups = plan_groups(
        open_plan_mix([f"{folders[0]}=8, procedural:home", "procedural:office:loops=0.5"])
    )
    assert [group.weight for group in groups] == [8.0, 1.0, 0.5]
    assert groups[1].ids[0] == "home_0_00000"
    assert groups[2].ids[0] == "office_loops_0_00000"


def test_a_file_with_a_comma_and_an_equals_sign_in_its_name_is_a_file(tmp_path):
    folder = tmp_path / "a,b=3"
    write_houseexpo(folder / "plan.json", FloorPlan("plan", box(0, 0, 3, 4)))
    assert list(open_plan_mix([str(folder)]).ids) == ["plan"]


def test_a_single_source_is_itself(folders):
    assert len(plan_groups(open_plan_mix(["procedural"]))) == 1
    assert plan_groups(open_plans("procedural"))[0].weight == 1.0


def test_a_mix_can_be_sent_to_a_worker(folders):
    source = open_plan_mix([*folders, "procedural"])
    copy = pickle.loads(pickle.dumps(source))
    assert copy.load("procedural_0_00003") == source.load("procedural_0_00003")


@pytest.mark.parametrize(
    ("specs", "words"),
    [
        (["bundled", "procedural=0"], "weight"),
        (["bundled", "bundled=2"], "given twice"),
        ([""], "no floor plans are named"),
        (["bundled", "bundeld2"], "did you mean 'bundled'"),
        (["procedural:ofice"], "'home', 'office' or 'loops'"),
    ],
)
def test_senseless_mixes_are_refused(specs, words):
    with pytest.raises(ConfigError, match=words):
        open_plan_mix(specs)


def test_missing_files_are_named_and_ids_need_one_source(folders, tmp_path):
    with pytest.raises(InputFileError, match="gone"):
        open_plan_mix([folders[0], str(tmp_path / "gone.tar.gz")])
    with pytest.raises(ConfigError, match="single source"):
        open_plan_mix(folders, ids_file=tmp_path / "ids.txt")


def test_kinds_of_generated_plans():
    homes, offices = open_plans("procedural:home:3"), open_plans("procedural:office:loops:3")
    assert homes.ids[0] == "home_3_00000"
    built = [offices.load(plan_id) for plan_id in offices.ids[:6]]
    for office in built:
        check_plan(office)
    # A way round encloses something. An office whose rooms all lie side by side has none.
    assert sum(len(office.free_space.interiors) > 0 for office in built) >= 4
    assert min(office.area for office in built) >= 150.0 * 0.8  # less its walls
    assert check_plan(homes.load(homes.ids[0])) is None

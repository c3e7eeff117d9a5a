import io
import json
import pickle
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from shapely import affinity

from slamgym.cad import FloorPlan, check_plan, open_plans, write_houseexpo
from slamgym.cad.sources import generated_plans, open_plan_mix
from slamgym.core.errors import ConfigError, InputFileError, PlanError, SlamgymError
from slamgym.interop.ros_map import write_ros_map

HOUSEEXPO = Path(__file__).parents[3] / "shared" / "data" / "houseexpo"


@pytest.fixture
def bundled():
    source = open_plans("bundled")
    return {plan_id: source.load(plan_id) for plan_id in source.ids}


@pytest.fixture
def archive(tmp_path, bundled):
    """An archive laid out as HouseExpo's: ``json/<id>.json``, and files that aren't plans."""
    path = tmp_path / "json.tar.gz"
    with tarfile.open(path, "w:gz") as tar:
        for name, text in [("json/readme.txt", b"hello"), ("json/broken.json", b"{")]:
            _add(tar, name, text)
        for plan_id in list(bundled)[:3]:
            write_houseexpo(tmp_path / "plan.json", bundled[plan_id])
            _add(tar, f"json/{plan_id}.json", (tmp_path / "plan.json").read_bytes())
    return path


def _add(tar, name, content):
    info = tarfile.TarInfo(name)
    info.size = len(content)
    tar.addfile(info, io.BytesIO(content))


def test_the_bundled_plans_are_explorable_homes_and_offices(bundled):
    assert len(bundled) == 24
    for plan in bundled.values():
        check_plan(plan, robot_radius=0.22, max_extent=32.0)
        assert plan.rooms
        assert plan.doors
    assert sum(plan_id.startswith("office") for plan_id in bundled) == 6
    assert sum(len(plan.free_space.interiors) > 0 for plan in bundled.values()) >= 7


def test_an_archive_a_folder_and_a_file_give_the_same_plans(archive, tmp_path, bundled):
    source = open_plans(archive)
    folder = tmp_path / "folder"
    good = [plan_id for plan_id in source.ids if plan_id != "broken"]
    assert len(source) == 4
    for plan_id in good:
        write_houseexpo(folder / f"{plan_id}.json", source.load(plan_id))
        assert source.load(plan_id).free_space.equals(bundled[plan_id].free_space)
    from_folder = open_plans(folder)
    assert list(from_folder.ids) == good
    assert (
        open_plans(folder / f"{good[0]}.json").load(good[0]).segments().shape
        == bundled[good[0]].segments().shape
    )


def test_plans_of_one_name_in_two_folders_are_refused_not_lost(tmp_path, bundled):
    first, second = list(bundled.values())[:2]
    write_houseexpo(tmp_path / "in" / "a" / "1.json", first)
    write_houseexpo(tmp_path / "in" / "b" / "1.json", second)
    with tarfile.open(tmp_path / "in.tar.gz", "w:gz") as tar:
        for folder in ("a", "b"):
            _add(tar, f"in/{folder}/1.json", (tmp_path / "in" / folder / "1.json").read_bytes())
    for spec in (tmp_path / "in", tmp_path / "in.tar.gz"):
        with pytest.raises(
            InputFileError,
            match=r"holds two plans called '1', '(in/)?a/1\.json' and '(in/)?b/1\.json'",
        ):
            open_plans(spec)
    # As the sentence says: as two sources both are there.
    mix = open_plan_mix([str(tmp_path / "in" / "a"), str(tmp_path / "in" / "b")])
    assert list(mix.ids) == ["1", "1~2"]


def test_errors_name_the_member_of_an_archive(archive):
    with pytest.raises(PlanError, match=r"json\.tar\.gz:broken\.json: is not valid JSON"):
        open_plans(archive).load("broken")


def test_an_id_file_selects_and_orders(archive, tmp_path):
    ids = list(open_plans(archive).ids)[::-1][:2]
    (tmp_path / "ids.txt").write_text("\n".join([ids[0], "", ids[1], ids[0]]) + "\n")
    source = open_plans(archive, tmp_path / "ids.txt")
    assert list(source.ids) == ids
    assert source.load(ids[1]).id == ids[1]
    assert open_plans("bundled", tmp_path / "ids.txt").ids[0] == ids[0]


def test_an_id_file_with_unknown_ids_or_nothing_is_refused(archive, tmp_path):
    ids = tmp_path / "ids.txt"
    ids.write_text("home_nowhere\n")
    with pytest.raises(InputFileError, match=r"1 of its 1 ids are not in .*'home_nowhere'"):
        open_plans(archive, ids)
    ids.write_text("\n")
    with pytest.raises(InputFileError, match="no plan ids"):
        open_plans(archive, ids)
    with pytest.raises(InputFileError, match="can't be read"):
        open_plans(archive, tmp_path / "gone.txt")


def test_procedural_plans_depend_on_seed_and_index_alone():
    source = open_plans("procedural:5")
    first, second = source.ids[0], source.ids[1]
    later = source.load(second), source.load(first)
    again = open_plans("procedural:5")
    assert again.load(first) == later[1]
    assert again.load(second) == later[0]
    assert later[0].id == second
    assert open_plans("procedural:6").ids[0] != first
    assert len(generated_plans(count=7)) == 7


@pytest.mark.parametrize("spec", ["bundled", "procedural:2"])
def test_a_source_can_be_sent_to_a_worker(spec):
    source = open_plans(spec)
    copy = pickle.loads(pickle.dumps(source))
    assert copy.load(copy.ids[3]) == source.load(source.ids[3])


def test_a_ros_map_and_a_picture_are_plans(tmp_path, bundled):
    plan: FloorPlan = next(iter(bundled.values()))
    grid = plan.raster(0.05)
    write_ros_map(tmp_path / "flat", grid)
    from_map = open_plans(tmp_path / "flat.yaml")
    assert list(from_map.ids) == ["flat"]
    assert from_map.load("flat").area == pytest.approx(plan.area, rel=0.02)
    cv2.imwrite(str(tmp_path / "flat.png"), grid.cells)
    from_picture = open_plans(f"{tmp_path / 'flat.png'}@0.05")
    assert from_picture.load("flat").area == pytest.approx(plan.area, rel=0.02)


def test_a_folder_of_ros_maps_is_a_source_and_a_yaw_turns_the_plan(tmp_path, bundled):
    plan = next(iter(bundled.values()))
    for name in ("first", "second"):
        write_ros_map(tmp_path / name, plan.raster(0.05))
    path = tmp_path / "second.yaml"
    path.write_text(path.read_text().replace(", 0.0]", ", 0.5]"))
    source = open_plans(tmp_path)
    assert source.ids == ["first", "second"]
    straight, turned = (source.load(plan_id).free_space for plan_id in source.ids)
    assert turned.area == pytest.approx(straight.area)
    frame = plan.raster(0.05).frame
    corner = (frame.origin_x, frame.origin_y)
    expected = affinity.rotate(straight, 0.5, origin=corner, use_radians=True)
    assert turned.symmetric_difference(expected).area < 1e-6 * straight.area


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ("bundeld", "did you mean 'bundled'"),
        ("procedural:x", "must be a whole number"),
        ("nowhere/plans.tar.gz", "no such file"),
        ("gone.json", "no such file"),
        ("gone.png@0.05", "no such file"),
        ("gone.png@much", "metres per pixel"),
        ("gone.png@-1", "metres per pixel"),
    ],
)
def test_what_is_no_source_of_plans_is_one_error(spec, reason):
    with pytest.raises((ConfigError, InputFileError), match=reason):
        open_plans(spec)


def test_files_of_other_kinds_are_refused(tmp_path):
    for name, content, reason in [
        ("a.tar.gz", b"no archive", "not a readable archive"),
        ("a.tar.gz", b"\x1f\x8b\x08\x00trunc", "not a readable archive"),
        ("a.txt", b"", "no known kind"),
        ("a.png", b"", "needs its metres per pixel"),
    ]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SlamgymError, match=reason):
            open_plans(tmp_path / name)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputFileError, match="holds no floor plans"):
        open_plans(tmp_path / "empty")


@pytest.mark.skipif(not HOUSEEXPO.exists(), reason="needs the HouseExpo archive")
def test_houseexpo_itself_reads_with_few_rejections(tmp_path):
    ids = (HOUSEEXPO / "map_id_train.txt").read_text().split()[:150]
    (tmp_path / "ids.txt").write_text("\n".join(ids))
    source = open_plans(HOUSEEXPO / "json.tar.gz", tmp_path / "ids.txt")
    loaded, usable = 0, 0
    for plan_id in source.ids:
        try:
            plan = source.load(plan_id)
            loaded += 1
            check_plan(plan, robot_radius=0.22, max_extent=64.0)
            usable += 1
        except PlanError as error:
            assert plan_id in str(error)  # noqa: PT017 - the error is one of many, not the outcome
    # Over 3,000 plans 0.4 % did not load and 4 % could not be explored.
    assert loaded >= 0.98 * len(ids)
    assert usable >= 0.92 * len(ids)


def test_bundled_files_are_in_the_houseexpo_format():
    for path in (Path(__file__).parents[2] / "slamgym" / "cad" / "bundled").glob("*.json"):
        data = json.loads(path.read_text())
        assert {"verts", "id", "room_category", "room_num", "bbox"} <= set(data)
        assert data["id"] == path.stem
        assert np.allclose(np.min(data["verts"], axis=0), data["bbox"]["min"])

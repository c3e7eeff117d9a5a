"""The command: what it writes, and one clear error with nothing written for every kind of bad input."""

import json

import numpy as np
import pytest
import shapely

from slamgym.cad.floorplan import FloorPlan, Room
from slamgym.cad.houseexpo import write_houseexpo
from slamgym.commands.cli import TABLE
from slamgym.core.errors import InputFileError, PlanError, SlamgymError
from slamgym.dataset import load_pair, read_manifest
from slamgym.dataset.curate.split import PlanSide, SplitTable, make_split, read_split
from slamgym.dataset.images.render import render_images, select_pairs
from slamgym.dataset.images.square_images import ImageConfig
from slamgym.interop import read_ros_map, read_tum, write_tum
from slamgym.parametric.paths import read_waypoints
from slamgym.parametric.tours import plan_trajectory


def main(argv):
    return TABLE.run("slamgym", ["deform", *map(str, argv)])


@pytest.fixture
def plan_file(flat, tmp_path):
    path = tmp_path / "flat.json"
    write_houseexpo(path, flat)
    return path


@pytest.fixture(scope="module")
def explored(flat, tmp_path_factory):
    """A dataset of two short explorations with a split."""
    folder = tmp_path_factory.mktemp("deform")
    root = folder / "explored"
    plan_file = folder / "flat.json"
    write_houseexpo(plan_file, flat)
    options = ("--pairs", "2", "--minutes", "0.5", "--explorer", "nearest", "--workers", "1")
    TABLE.run("slamgym", ["generate", "--plans", str(plan_file), "-o", str(root), *options])
    make_split(root, test=1.0)
    return root


def csv(path, rows) -> str:
    path.write_text("x,y\n" + "".join(",".join(str(v) for v in row) + "\n" for row in rows))
    return str(path)


def episodes(out):
    return sorted((out / "episodes").iterdir())


def test_it_writes_a_dataset_that_reads_back(plan_file, tmp_path, capsys) -> None:
    out = tmp_path / "out"
    options = ("--method", "parametric", "--count", "2", "--resolution", "0.1", "--seed", "3")
    assert main([str(plan_file), "-o", str(out), *options]) == 0
    assert "2 map(s) of flat" in capsys.readouterr().out
    records = list(read_manifest(out))
    assert [record.plan_id for record in records] == ["flat", "flat"]
    maps = []
    for record, folder in zip(records, episodes(out), strict=True):
        grid = read_ros_map(folder / "map.yaml")
        assert np.load(folder / "field.npz")["field"].shape == (2, *grid.cells.shape)
        true = read_tum(folder / "truth.tum")
        believed = read_tum(folder / "estimate.tum")
        assert len(true) == len(believed) > 20
        np.testing.assert_allclose(
            true.poses[0, :2], 0.0, atol=1e-5
        )  # the map frame begins where the robot does
        cad, slam = load_pair(out, record.name)
        np.testing.assert_array_equal(slam, grid.cells)
        assert cad.shape == slam.shape
        assert record.coverage > 0.5
        facts = json.loads((folder / "parameters.json").read_text())
        assert facts["config"]["severity"] == 1.0
        assert {"wheels", "phases", "lidar"} <= set(facts["drawn"])
        maps.append(slam)
    assert maps[0].shape != maps[1].shape or (maps[0] != maps[1]).any()


def test_what_it_writes_can_be_shown_and_rendered(plan_file, tmp_path) -> None:
    out = tmp_path / "out"
    images = tmp_path / "images"
    main([str(plan_file), "-o", str(out), "--method", "elastic", "--count", "2"])
    table = SplitTable(0, 0.1, {"flat": PlanSide("train", "flat")})
    render_images(out, images, ImageConfig(), table, selection=select_pairs(out))
    assert len(list(images.glob("*/B/*.png"))) == 2
    assert (
        TABLE.run("slamgym", ["dataset", "show", str(out), "--out", str(tmp_path / "sheet.png")])
        == 0
    )


@pytest.mark.parametrize("recipe", [["--method", "parametric"], ["--recipe", "real"]])
def test_the_same_seed_writes_the_same_map(plan_file, tmp_path, recipe) -> None:
    for name in ("a", "b"):
        main([str(plan_file), "-o", str(tmp_path / name), "--resolution", "0.1", *recipe])
    for file in ("map.pgm", "field.npz"):
        first, second = ((episodes(tmp_path / name)[0] / file).read_bytes() for name in ("a", "b"))
        assert first == second


@pytest.mark.parametrize("conversion", ["two_phase", "ekf_schur", "ekf"])
def test_a_waypoint_file_and_a_size(plan_file, tmp_path, tour_points, conversion) -> None:
    way = csv(tmp_path / "way.csv", tour_points)
    out = tmp_path / "out"
    options = ("--method", "parametric", "--size", "64", "--conversion", conversion)
    main([str(plan_file), "-o", str(out), "--trajectory", way, *options])
    folder = episodes(out)[0]
    assert read_ros_map(folder / "map.yaml").cells.shape == (64, 64)
    end = read_tum(folder / "truth.tum").poses[-1, :2] + tour_points[0]
    np.testing.assert_allclose(end, tour_points[-1], atol=1e-5)


@pytest.mark.parametrize("equations", ["corrected", "printed"])
def test_an_ekf_of_64_pixels_enlarged_to_256(plan_file, tmp_path, capsys, equations) -> None:
    out = tmp_path / "out"
    options = ("--conversion", "ekf", "--equations", equations, "--size", "64", "--resize", "256")
    main([str(plan_file), "-o", str(out), "--method", "parametric", *options])
    assert "ekf took" in capsys.readouterr().out
    folder = episodes(out)[0]
    assert read_ros_map(folder / "map.yaml").cells.shape == (256, 256)
    facts = json.loads((folder / "parameters.json").read_text())
    assert facts["config"]["equations"] == equations


def test_rooms_that_a_tour_leaves_out_are_named(tmp_path, capsys) -> None:
    closed = shapely.box(0.0, 0.0, 6.0, 4.0).difference(shapely.box(3.0, 0.0, 3.1, 3.7))
    rooms = (
        Room("Bedroom", shapely.box(0.0, 0.0, 3.0, 4.0)),
        Room("Bath", shapely.box(3.1, 0, 6, 4)),
    )
    path = tmp_path / "closed.json"
    write_houseexpo(path, FloorPlan("closed", closed, rooms))
    main([str(path), "-o", str(tmp_path / "out"), "--method", "parametric", "--size", "64"])
    said = capsys.readouterr().err
    assert said.count("leaves out") == 1
    assert ("Bedroom at (1.5, 2.0)" in said) != ("Bath at (4.5, 2.0)" in said)


def test_plans_that_cannot_be_used_are_counted_by_their_reason(plan_file, tmp_path) -> None:
    plans = tmp_path / "plans"
    plans.mkdir()
    for name in ("a", "b", "c"):
        (plans / f"{name}.json").write_text('{"id": "x", "verts": 3}')
    write_houseexpo(plans / "d.json", FloorPlan("d", shapely.box(0.0, 0.0, 6.0, 0.001)))
    with pytest.raises(SlamgymError, match=r"none of the 4 plans .* can be used; 3 of 4: .*verts"):
        main([str(plans), "-o", str(tmp_path / "out"), "--plans", "2"])
    options = ("--plans", "2", "--plans-filter", "useful")
    hall = tmp_path / "hall"
    hall.mkdir()
    write_houseexpo(hall / "a.json", FloorPlan("a", shapely.box(0.0, 0.0, 60.0, 60.0)))
    with pytest.raises(SlamgymError, match="1 of 1: --plans-filter useful omits it"):
        main([str(hall), "-o", str(tmp_path / "out"), *options])


def test_a_recorded_path(plan_file, tmp_path, tour) -> None:
    recorded = tmp_path / "recorded.tum"
    write_tum(recorded, tour)
    main(
        [
            str(plan_file),
            "-o",
            str(tmp_path / "a"),
            "--trajectory",
            str(recorded),
            "--resolution",
            "0.1",
        ]
    )
    assert len(read_tum(episodes(tmp_path / "a")[0] / "truth.tum")) > 20


def test_several_plans_of_a_source_and_several_hypotheses_of_each(
    plan_file, tmp_path, capsys
) -> None:
    """A plan without a free cell is passed over, and each hypothesis has its own name and map."""
    plans = tmp_path / "plans"
    plans.mkdir()
    for name in ("a", "b", "c"):
        (plans / f"{name}.json").write_text(plan_file.read_text())
    write_houseexpo(plans / "aa.json", FloorPlan("aa", shapely.box(0.0, 0.0, 6.0, 0.001)))
    out = tmp_path / "out"
    options = ("--plans", "2", "--count", "2", "--resolution", "0.2", "--method", "elastic")
    assert main([str(plans), "-o", str(out), *options]) == 0
    assert "4 map(s) of 2 plans" in capsys.readouterr().out
    records = list(read_manifest(out))
    assert [(record.plan_id, record.repetition) for record in records] == [
        ("a", 0), ("a", 1), ("b", 0), ("b", 1),
    ]  # fmt: skip
    assert len({load_pair(out, record.name)[1].tobytes() for record in records}) == 4


def test_a_dataset_is_drawn_anew_along_its_own_paths(explored, tmp_path) -> None:
    """Each pair keeps name, plan, true path, start and side; the map is another."""
    out = tmp_path / "anew"
    assert main([str(explored), "-o", str(out), "--method", "generator", "--seed", "4"]) == 0
    assert read_split(out) == read_split(explored)
    for one, other in zip(read_manifest(explored), read_manifest(out), strict=True):
        assert (one.name, one.plan_id, one.explorer) == (other.name, other.plan_id, other.explorer)
        driven, again = (
            read_tum(root / "episodes" / one.name / "truth.tum").poses for root in (explored, out)
        )
        # Recorded places are taken for the ends of sweeps: scans begin up to 0.1 s at 0.26 m/s before them, and
        # millimetres are what the files' digits leave.
        gaps = np.hypot(*(driven[None, :, :2] - again[:, None, :2]).transpose(2, 0, 1)).min(axis=1)
        assert gaps.max() < 0.03
        assert other.area == one.area
        assert abs(other.coverage - one.coverage) < 0.1
        assert load_pair(out, one.name)[1].tobytes() != load_pair(explored, one.name)[1].tobytes()


def test_several_hypotheses_of_a_dataset_have_names_of_their_own(explored, tmp_path) -> None:
    out = tmp_path / "anew"
    main(
        [
            str(explored),
            "-o",
            str(out),
            "--count",
            "2",
            "--method",
            "parametric",
            "--conversion",
            "two_phase",
        ]
    )
    assert len({record.name for record in read_manifest(out)}) == 4


@pytest.mark.parametrize(
    ("arguments", "message"), [(["--plans", "2"], "--plans has no effect on a dataset")]
)
def test_options_that_a_dataset_answers_are_refused(explored, tmp_path, arguments, message) -> None:
    with pytest.raises(SlamgymError, match=message):
        main([str(explored), "-o", str(tmp_path / "out"), *arguments])


def test_a_deformed_dataset_is_not_taken_for_explorations(plan_file, tmp_path) -> None:
    main([str(plan_file), "-o", str(tmp_path / "a"), "--method", "elastic"])
    with pytest.raises(InputFileError, match="no dataset of explorations"):
        main([str(tmp_path / "a"), "-o", str(tmp_path / "b"), "--method", "elastic"])


BAD_PATHS = {
    "through a wall": ([(1.5, 1.5), (4.5, 1.5)], "leads through a wall"),
    "in a wall": ([(1.5, 1.5), (3.05, 1.0)], "waypoint 2 at .* lies in a wall"),
    "outside": ([(1.5, 1.5), (15.0, 1.5)], "lies outside the plan"),
    "one point": ([(1.5, 1.5)], "has 1 waypoint"),
    "NaN": ([(1.5, 1.5), ("nan", 1.0)], "not a pair of finite numbers"),
    "decreasing times": ([(1.5, 1.5, 9.0), (1.5, 2.5, 3.0)], "times of arrival must increase"),
    "words": ([(1.5, 1.5), ("north", 1.0)], "not a line of numbers"),
    "ragged": ([(1.5, 1.5), (1.5, 2.5, 3.0)], "like the rest"),
    "empty": ([], "has no waypoint"),
}


@pytest.mark.parametrize("case", BAD_PATHS)
def test_bad_trajectories_give_one_clear_error_and_write_nothing(plan_file, tmp_path, case) -> None:
    rows, message = BAD_PATHS[case]
    way = csv(tmp_path / "way.csv", rows)
    with pytest.raises(SlamgymError, match=message) as error:
        main([str(plan_file), "-o", str(tmp_path / "out"), "--trajectory", way])
    assert "way.csv" in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flat.json", "way.csv"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--method", "parametric", "--severity", "-1"],
            r"--severity must be in \[0, 10\], not -1",
        ),
        (
            ["--method", "parametric", "--severity", "11"],
            r"--severity must be in \[0, 10\], not 11",
        ),
        (
            ["--method", "parametric", "--severity", "nan"],
            r"--severity must be in \[0, 10\], not nan",
        ),
        (["--count", "0"], "--count must be at least 1, not 0"),
        (["--severity", "2"], "--severity has no effect with --method generator"),
        (
            ["--method", "modelprog", "--weights", "slam2cad"],
            "translate SLAM maps to CAD maps, not",
        ),
        (["--method", "generator", "--weights", "modelprog"], "take --method modelprog"),
        (["--method", "generator", "--recipe", "papper"], "papper"),
        (["--method", "parametric", "--recipe", "paper"], "take --method generator"),
        (["--resolution", "-0.1"], "--resolution must be above 0"),
        (["--equations", "printed"], "--equations has no effect with --method generator"),
        (["--method", "parametric", "--conversion", "ekf"], r"ekf would keep .* GB.*--size 128"),
        (["--method", "parametric", "--resize", "256"], "--resize enlarges a map of --size"),
        (
            ["--method", "parametric", "--size", "64", "--resize", "32"],
            "--resize must be at least --size, 64, not 32",
        ),
        (["--size", "3"], "--size must be 0 or at least 16, not 3"),
        (["--seed", "-4"], "--seed must be at least 0, not -4"),
        (["--trajectory", "missing.csv"], "missing.csv"),
        (["--plan-id", "nowhere"], "has no plan 'nowhere'"),
        (["--plan-id", "flat", "--plans", "2"], "exclude each other"),
    ],
)
def test_bad_arguments_give_one_clear_error_and_write_nothing(
    plan_file, tmp_path, arguments, message
) -> None:
    with pytest.raises(SlamgymError, match=message):
        main([str(plan_file), "-o", str(tmp_path / "out"), *arguments])
    assert [path.name for path in tmp_path.iterdir()] == ["flat.json"]


def test_an_earlier_dataset_is_replaced_by_overwrite_and_nothing_else_is(
    plan_file, tmp_path, monkeypatch
) -> None:
    command = [str(plan_file), "--resolution", "0.2", "-o"]
    out = tmp_path / "out"
    main([*command, str(out)])
    (out / "precious").write_text("mine")
    with pytest.raises(InputFileError, match="--overwrite"):
        main([*command, str(out)])
    assert (out / "precious").read_text() == "mine"
    main([*command, str(out), "--overwrite"])
    assert len(episodes(out)) == 1
    with pytest.raises(InputFileError, match="holds no dataset of `slamgym deform`"):
        main([*command, str(plan_file.parent), "--overwrite"])
    monkeypatch.chdir(out)
    with pytest.raises(InputFileError, match="is the folder that you are in"):
        main([*command, ".", "--overwrite"])
    assert plan_file.is_file()


def test_a_plan_without_free_space_is_refused() -> None:
    narrow = FloorPlan("slit", shapely.box(0.0, 0.0, 6.0, 0.3))
    with pytest.raises(PlanError, match="slit"):
        plan_trajectory(narrow, np.random.default_rng(0))
    hairline = FloorPlan("hairline", shapely.box(0.0, 0.0, 6.0, 0.001))
    with pytest.raises(PlanError, match="hairline"):
        plan_trajectory(hairline, np.random.default_rng(0))


@pytest.mark.parametrize("method", ["parametric", "generator", "elastic", "modelprog"])
def test_a_plan_without_a_free_cell_is_refused_by_every_method(tmp_path, method) -> None:
    path = tmp_path / "hairline.json"
    write_houseexpo(path, FloorPlan("hairline", shapely.box(0.1, 0.0, 0.5, 6.0)))
    with pytest.raises(PlanError, match="no free cell"):
        main([str(path), "-o", str(tmp_path / "out"), "--method", method, "--resolution", "3"])
    assert not (tmp_path / "out").exists()


def test_waypoint_files_may_have_comments_semicolons_and_times(tmp_path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("# tour\n1;2;0\n3;2;20 # door\n\n")
    waypoints = read_waypoints(path)
    np.testing.assert_allclose(waypoints.points, [[1.0, 2.0], [3.0, 2.0]])
    np.testing.assert_allclose(waypoints.times, [0.0, 20.0])

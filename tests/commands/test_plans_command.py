import json

import cv2
import numpy as np
import pytest

from slamgym.cad import generate_plan, open_plans, write_houseexpo
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError, SlamgymError
from slamgym.viz.plan_pictures import draw_floor_plan, draw_plan_sheet


def main(argv):
    return TABLE.run("slamgym", ["plans", *map(str, argv)])


FAULTS = {
    "malformed": "{",
    "nan": '{"verts": [[0, 0], [NaN, 0], [1, 1]]}',
    "two_vertices": '{"verts": [[0, 0], [1, 0]]}',
    "crossing": '{"verts": [[0, 0], [2, 2], [2, 0], [0, 2]]}',
    "flat": '{"verts": [[0, 0], [1, 1], [2, 2]]}',
    "disjoint": '{"verts": [[0, 0], [2, 0], [2, 2], [4, 2], [4, 4], [2, 4], [2, 2], [0, 2]]}',
    "narrow": '{"verts": [[0, 0], [9, 0], [9, 0.4], [0, 0.4]]}',
    "giant": '{"verts": [[0, 0], [900, 0], [900, 5], [0, 5]]}',
}


@pytest.fixture
def folder(tmp_path):
    """Two good plans and one with each fault."""
    plans = tmp_path / "in"
    for seed in (1, 2):
        write_houseexpo(plans / f"good_{seed}.json", generate_plan(seed))
    for name, text in FAULTS.items():
        (plans / f"{name}.json").write_text(text)
    return plans


def rejected(path):
    return {entry["plan"]: entry for entry in map(json.loads, path.read_text().splitlines())}


def test_check_goes_on_past_bad_plans_and_writes_them_down(folder, tmp_path, capsys):
    out = tmp_path / "rejected.jsonl"
    assert main(["check", str(folder), "--rejected", str(out)]) == 1
    printed = capsys.readouterr()
    assert "2 of 10 plans can be explored" in printed.out
    assert "Left out 8 plans" in printed.err
    entries = rejected(out)
    assert set(entries) == set(FAULTS)
    for name, entry in entries.items():
        assert set(entry) == {"plan", "source", "reason"}
        assert entry["source"].endswith(f"{name}.json")
        assert f"{name}.json: {entry['reason']}" in printed.err
    assert "900.0 m" in entries["giant"]["reason"]


def test_check_of_good_plans_leaves_no_file(tmp_path, capsys):
    out = tmp_path / "rejected.jsonl"
    assert main(["check", "bundled", "--rejected", str(out)]) == 0
    assert not out.exists()
    assert "24 of 24" in capsys.readouterr().out


def test_list_prints_a_line_per_plan(folder, capsys):
    assert main(["list", str(folder)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["id", "good_1", "good_2"]
    assert float(lines[1].split()[1]) == pytest.approx(generate_plan(1).area, abs=0.1)


def test_write_keeps_generated_plans_readable(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["write", "procedural:9", "--count", "3", "--out", str(out)]) == 0
    assert "3 plans written" in capsys.readouterr().out
    written = open_plans(out)
    source = open_plans("procedural:9")
    assert list(written.ids) == list(source.ids[:3])
    for plan_id in written.ids:
        assert written.load(plan_id).free_space.equals(source.load(plan_id).free_space)


def test_write_lists_what_it_left_out(folder, tmp_path):
    out = tmp_path / "out"
    assert main(["write", str(folder), "--out", str(out)]) == 0
    assert set(rejected(out / "rejected.jsonl")) == set(FAULTS)


def test_it_is_a_failure_if_no_plan_can_be_used(folder, tmp_path):
    bad = folder / "crossing.json"
    for arguments in (
        ["list"],
        ["draw", "--out", tmp_path / "a.png"],
        ["write", "--out", tmp_path],
    ):
        assert main([arguments[0], bad, *arguments[1:]]) == 1
    assert not (tmp_path / "a.png").exists()


def test_draw_makes_a_sheet(folder, tmp_path):
    out = tmp_path / "sheet.png"
    assert main(["draw", str(folder), "--out", str(out)]) == 0
    sheet = cv2.imread(str(out))
    assert 2 * 360 < sheet.shape[1] < 3 * 360
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 20


def test_a_sheet_is_no_vector_drawing(folder, tmp_path):
    with pytest.raises(InputFileError, match=r"end its name in \.png or \.jpg"):
        main(["draw", str(folder), "--out", str(tmp_path / "sheet.svg")])
    assert not list(tmp_path.glob("sheet*"))


def test_a_drawing_shows_floor_walls_and_doors_with_y_up():
    plan = generate_plan(0)
    picture = draw_floor_plan(plan, 300)
    assert picture.shape == (300, 300, 3)
    min_x, min_y, max_x, max_y = plan.bounds
    side = 1.12 * max(max_x - min_x, max_y - min_y) + 0.5
    inside = plan.raster(side / 300)
    # As many bright coloured pixels as there is floor, to within the walls' antialiasing.
    walls = (picture.max(axis=2) < 80).mean() * side**2
    assert 0.02 * plan.area < walls < plan.area
    assert (inside.cells == 254).any()
    reds = (picture[:, :, 0].astype(int) - picture[:, :, 2] > 120).sum()
    assert reds > 0
    two, one = (draw_plan_sheet([plan] * count, columns=6, size_px=100) for count in (2, 1))
    assert two.shape[1] == 2 * one.shape[1]


def test_mistakes_are_one_error(tmp_path):
    with pytest.raises(ConfigError, match="too many for one picture"):
        main(["draw", "procedural", "--out", str(tmp_path / "a.png")])
    with pytest.raises(ConfigError, match="--count must be"):
        main(["list", "--count", "0"])
    with pytest.raises(ConfigError, match="did you mean 'bundled'"):
        main(["list", "bundle"])
    (tmp_path / "file").write_text("")
    with pytest.raises(InputFileError, match="can't be written"):
        main(["write", "--count", "1", "--out", str(tmp_path / "file" / "out")])


def test_check_and_generate_judge_a_giant_alike(tmp_path, capsys):
    path = tmp_path / "mall.json"
    path.write_text('{"verts": [[0, 0], [10000, 0], [10000, 5], [0, 5]]}')
    assert main(["check", str(path), "--rejected", str(tmp_path / "rejected.jsonl")]) == 1
    checked = rejected(tmp_path / "rejected.jsonl")["mall"]["reason"]
    with pytest.raises(SlamgymError, match=r"no plan gave a pair \(of 1\)"):
        TABLE.run(
            "slamgym",
            [
                "generate",
                "--plans",
                str(path),
                "--pairs",
                "1",
                "--workers",
                "1",
                "--out",
                str(tmp_path / "out"),
            ],
        )
    generated = json.loads((tmp_path / "out" / "rejected.jsonl").read_text().splitlines()[0])[
        "reason"
    ]
    assert checked == generated
    assert "10000.0 m long but the map holds 353.6 m" in checked


def test_the_plans_themselves_are_not_written_over(tmp_path):
    path = tmp_path / "a.json"
    write_houseexpo(path, generate_plan(1))
    before = path.read_bytes()
    for words in (
        ["write", str(path), "--out", str(tmp_path)],
        ["draw", str(path), "--out", str(path)],
    ):
        with pytest.raises(InputFileError, match="would be written over"):
            main(words)
    assert path.read_bytes() == before

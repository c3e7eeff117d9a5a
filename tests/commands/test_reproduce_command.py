"""The reproduction: its steps resume, its verdicts follow from the intervals, its report is whole."""

import base64
import json
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import cv2
import numpy as np
import pytest
from help_pages import help_pages, options_of

from slamgym.commands import cli
from slamgym.commands.reproduce import figures, nearness, protocol, steps
from slamgym.commands.reproduce.claims import Findings, judge_claims
from slamgym.commands.reproduce.conversions import (
    CONVERSIONS,
    EKF_A,
    EKF_B,
    OURS,
    TWO_PHASE,
    conversion_claims,
    read_seconds,
    table_two,
)
from slamgym.commands.reproduce.nearness import Nearness, nearness_claims, wall_distance
from slamgym.commands.reproduce.own_claims import OWN_MEASURES, own_claims
from slamgym.commands.reproduce.protocol import (
    PAPER_IMPROVED,
    PAPER_MAPS,
    PAPER_MSE1,
    PAPER_MSE2,
    MapErrors,
    alignment_table,
    table_one_beside,
    table_one_claims,
)
from slamgym.commands.reproduce.steps import (
    REDRAWN,
    REPRODUCTION_SCALES,
    STEPS,
    TRAINED,
    Reproduction,
)
from slamgym.commands.reproduce.verdicts import ClaimVerdict, exact, judge, judge_error
from slamgym.core.errors import ConfigError, SlamgymError
from slamgym.core.intervals import Interval, wilson_interval
from slamgym.dataset.realism.comparison import MIN_MAPS
from slamgym.gan.evaluation.evaluate import RAW, THICKENED

PAGE = Path(__file__).parents[2] / "docs" / "reproduce.md"


def interval(value, low, high):
    return {"value": value, "low": low, "high": high}


def improvement(share, ratio, count=200):
    return {
        "count": count, "share_improved": share, "ratio_of_means": ratio, "sign_p": 0.01, "wilcoxon_p": 0.02,
        "mean_mse1": interval(0.04, 0.03, 0.05), "mean_mse2": interval(0.05, 0.04, 0.06),
    }  # fmt: skip


def measured(error=0.05, wall_f1=0.6, rooms=1.0):
    """The measures of a method."""
    return {
        "maps": 200,
        "mse": interval(error, 0.04, 0.06),
        "wall_f1_10cm": interval(wall_f1, 0.5, 0.7),
        "room_error": interval(rooms, 0.5, 1.5),
    }


def network(share, ratio):
    return measured() | {"improvement": improvement(share, ratio)}


PROTOCOL = {
    "methods": {
        RAW: measured(),
        THICKENED: network(interval(1.0, 0.98, 1.0), interval(0.56, 0.48, 0.64)),
        "model32": network(interval(0.55, 0.48, 0.62), interval(0.9, 0.85, 0.95)),
        "slam2cad": network(interval(0.9, 0.85, 0.95), interval(0.6, 0.5, 0.7)),
    }
}
TRUE_FACES = {
    "realism": {
        "tests": [
            {
                "first": "simulated",
                "second": second,
                "is_null": second == "simulated",
                "accuracy": accuracy,
            }
            for second, accuracy in (
                ("simulated", interval(0.49, 0.45, 0.53)),
                ("modelprog", interval(0.97, 0.95, 0.99)),
                ("modelprog, bent", interval(0.9, 0.8, 0.99)),
                ("generator", interval(0.55, 0.5, 0.6)),
                ("parametric", interval(0.59, 0.54, 0.64)),
            )
        ]
    }
}
STATISTICS = {"whole": {"cpu_seconds": 3.6, "kept": 0.2, "pairs": 100}}
ERRORS = MapErrors(
    coverage=np.array([0.72, 0.8, 0.99, 1.0]),
    unaligned=np.array([0.4, 0.3, 0.2, 0.1]),
    rigid=np.array([0.3, 0.2, 0.1, 0.1]),
    similarity=np.array([0.2, 0.1, 0.05, 0.018]),
    plans=["a", "b", "c", "d"],
)
DEFORMED = """0_flat: 9.1 m driven, 90 scans, ekf took 9.000 s, walls displaced 0.1 m rms
1_flat: 9.1 m driven, 90 scans, ekf took 1.500 s, walls displaced 0.1 m rms
2_flat: 9.1 m driven, 90 scans, ekf took 1.900 s, walls displaced 0.1 m rms
3 map(s) of 3 plans in 20.0 s: out/deformed/ekf_64
0_flat: 9.1 m driven, 90 scans, ekf took 2.000 s, walls displaced 0.1 m rms
1 map(s) of flat in 20.0 s: out/deformed/ekf_64_to_256
0_flat: 9.1 m driven, 90 scans, two_phase took 0.5 s, walls displaced 0.1 m rms
1_flat: 9.1 m driven, 90 scans, two_phase took 0.100 s, walls displaced 0.1 m rms
2_flat: 9.1 m driven, 90 scans, two_phase took 0.100 s, walls displaced 0.1 m rms
3 map(s) of 3 plans in 2.0 s: out/deformed/two_phase
0_flat: drawn
1 map(s) of flat in 0.1 s: out/deformed/elastic
"""


def nearer(parametric, modelprog):
    """Distances of two maps by both methods."""
    distances = {"parametric": np.array(parametric), "modelprog": np.array(modelprog)}
    return Nearness(distances, distances, [f"{n}" for n in range(len(parametric))])


@pytest.fixture
def run(tmp_path):
    return Reproduction(
        tmp_path / "out", REPRODUCTION_SCALES["smoke"], train=False, seed=1, workers=1
    )


@pytest.fixture
def commands(monkeypatch):
    """Commands are noted, not run; the one named by ``broken`` fails."""
    lines = []
    broken = [""]
    monkeypatch.setattr("slamgym.dataset.images.format.read_images", lambda *_: [])

    def note(step, line):
        if step == broken[0]:
            raise SlamgymError("broken")
        lines.append(line)
        return f"output of {step}\n"

    monkeypatch.setattr(steps, "_run_command", note)
    return lines, broken


def test_every_step_runs_once_and_an_interrupted_run_goes_on(run, commands):
    lines, broken = commands
    broken[0] = "translators"
    with pytest.raises(SlamgymError, match="broken"):
        run.run_steps()
    done = len(lines)
    assert list(json.loads((run.out / "state.json").read_text())["steps"]) == [
        "explorations",
        "cleaning",
        "protocol",
        "training",
        "table_one",
    ]
    broken[0] = ""
    again = Reproduction(run.out, run.scale, train=False, seed=1, workers=1)
    again.run_steps()
    assert list(again.steps) == list(STEPS)
    assert lines[done][:2] == ["gan", "evaluate"]
    assert (run.out / "logs" / "cleaning.txt").read_text() == "output of cleaning\n" * 4
    assert all(line[0] != "train" for line in lines)
    count = len(lines)
    Reproduction(run.out, run.scale, train=False, seed=1, workers=1).run_steps()
    assert len(lines) == count


def test_with_enough_test_maps_they_are_drawn_anew_and_compared(run, commands, monkeypatch):
    lines, _ = commands
    records = [SimpleNamespace(name=f"{n}") for n in range(MIN_MAPS)]
    monkeypatch.setattr("slamgym.dataset.images.format.read_images", lambda *_: records)
    run.run_steps()
    evaluate = next(line for line in lines if str(run.out / "evaluation") in line)
    assert "modelprog" in evaluate[evaluate.index("--weights") : evaluate.index("--generated")]
    assert any(str(run.out / "redrawn" / "modelprog") in line for line in lines)
    for method in REDRAWN:
        folder = run.out / "redrawn" / method
        deform = next(
            line
            for line in lines
            if line[:2] == ["deform", str(run.out / "pairs")] and method in line
        )
        assert str(folder) in deform
        assert lines.index(deform) < lines.index(evaluate)
        assert f"{method}={folder / 'episodes'}" in evaluate[evaluate.index("--generated") :]


def test_another_seed_needs_another_folder(run, commands, tmp_path):
    run.run_steps()
    with pytest.raises(ConfigError, match="choose a new folder"):
        Reproduction(run.out, run.scale, train=False, seed=2, workers=1)


def test_few_maps_are_not_drawn_anew(run, commands):
    lines, _ = commands
    run.run_steps()
    assert not any(str(run.out / "redrawn") in " ".join(line) for line in lines)
    evaluate = next(line for line in lines if str(run.out / "evaluation") in line)
    assert "modelprog" not in evaluate


def test_training_makes_networks_that_are_measured(run, commands, monkeypatch):
    lines, _ = commands
    records = [SimpleNamespace(name=f"{n}") for n in range(MIN_MAPS)]
    monkeypatch.setattr("slamgym.dataset.images.format.read_images", lambda *_: records)
    Reproduction(run.out, run.scale, train=True, seed=1, workers=1).run_steps()
    trained = {name: f"{TRAINED[name]}={run.out / 'runs' / name}" for name in TRAINED}
    protocol_line, true_faces_line = (line for line in lines if line[:2] == ["gan", "evaluate"])
    assert {trained["model32"], trained["slam2cad"]} <= set(protocol_line)
    assert trained["modelprog"] not in protocol_line
    assert {trained["modelprog"], trained["slam2cad"]} <= set(true_faces_line)


def rendered(lines, folder):
    """The command that rendered a folder."""
    return next(line for line in lines if line[:2] == ["dataset", "render"] and folder in line[-1])


def test_each_network_is_trained_at_the_scale_of_its_preset(run, commands):
    lines, _ = commands
    Reproduction(run.out, run.scale, train=True, seed=1, workers=1).run_steps()
    for train in (line for line in lines if line[:2] == ["gan", "train"]):
        render = rendered(lines, train[2])
        preset = train[train.index("--preset") + 1] if "--preset" in train else "slam2cad"
        is_fixed = "--scaling" in render
        assert is_fixed == (preset == "slam2cad"), train
        if is_fixed:
            scale = render[render.index("--metres-per-px") + 1]
            assert (scale, render[render.index("--size") + 1]) == ("0.05", "640")


def test_table_one_is_judged_on_incomplete_maps_with_the_papers_walls(run, commands):
    lines, _ = commands
    run.run_steps()
    by_paper = rendered(lines, f"{run.out}/protocol/images")
    assert by_paper[by_paper.index("--edge-px") + 1] == "7"
    assert by_paper[by_paper.index("--min-coverage") + 1] == "0.7"
    assert "--edge-px" not in rendered(lines, f"{run.out}/images")


def test_the_commands_know_their_options(commands, tmp_path):
    pages = help_pages()
    for scale in REPRODUCTION_SCALES.values():
        run = Reproduction(tmp_path, scale, train=True, seed=1, workers=1)
        for line in (line for name in STEPS for line in run.commands(name)):
            page = pages.get(line[0]) or pages[" ".join(line[:2])]
            assert {word for word in line if word.startswith("--")} <= set(options_of(page)), line
            assert "{" not in " ".join(line)


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.85, 0.95, "better than the paper"),
        (0.55, 0.95, "reproduced"),
        (0.55, 0.6, "less than the paper"),
        (0.3, 0.9, "too few maps to say"),
        (0.45, 0.6, "worse than the paper"),
        (0.3, 0.4, "worse than the paper"),
    ],
)
def test_each_verdict_says_where_an_interval_lies(low, high, verdict):
    middle = 0.5 * (low + high)
    paper = Interval(0.7, 0.65, 0.8)
    assert judge(Interval(middle, low, high), paper, bound=0.5) == verdict
    mirrored = Interval(-middle, -high, -low)
    assert judge_error(mirrored, Interval(-0.7, -0.8, -0.65), bound=-0.5) == verdict
    assert verdict in get_args(ClaimVerdict)


def test_the_paper_reproduces_itself():
    paper = Interval(0.7, 0.65, 0.8)
    assert judge(paper, paper, bound=0.5) == "reproduced"


def test_the_page_explains_the_verdicts_that_there_are():
    text = PAGE.read_text()
    assert all(f"- **{verdict}**" in text for verdict in get_args(ClaimVerdict))
    _, _, below = text.partition("| claim of the paper | here | verdict |\n|---|---|---|\n")
    table, _, _ = below.partition("\n\n")
    rows = [row for row in table.splitlines() if row.startswith("|")]
    given = [row.split("|")[-2].strip() for row in rows]
    assert len(given) >= 3
    assert set(given) <= set(get_args(ClaimVerdict))


def stored(name):
    """Rows of a result of reproduction."""
    path = PAGE.parents[1] / "benchmarks" / "results" / "reproduction" / f"{name}.json"
    return json.loads(path.read_text())["rows"]


def test_the_verdicts_of_the_page_follow_from_its_figures():
    for row in stored("laptop"):
        judged = judge if row["better"] == "more" else judge_error
        own = Interval(row["value"], row["low"], row["high"])
        paper = Interval(row["paper high"], row["paper low"], row["paper high"])
        assert judged(own, paper, row["bound"]) == row["verdict"], row["claim"]
    ratio = round(PAPER_MSE1 / PAPER_MSE2, 2)
    for row in stored("table_one"):
        error = Interval(row["MSE1 / MSE2"], row["low"], row["high"])
        assert judge_error(error, exact(ratio), 1.0) == row["verdict on the error"]
        share = wilson_interval(row["improved"], row["number"])
        improved = wilson_interval(PAPER_IMPROVED, PAPER_MAPS)
        assert judge(share, improved, 0.5) == row["verdict on improved"]


def test_verdicts_follow_from_the_figures():
    found = Findings(
        PROTOCOL, TRUE_FACES, STATISTICS, read_seconds(DEFORMED), nearer([1.0] * 9, [2.0] * 9)
    )
    claims = judge_claims(found)
    better, same, less, few, worse = get_args(ClaimVerdict)
    assert [claim.verdict for claim in claims] == [
        few, less, better, better, worse, same, less, same, same, same, same, better, better,
    ]  # fmt: skip
    assert claims[2].own.startswith("180 of 200: 90 % [85, 95]")
    assert claims[2].paper == "14 of 21: 67 % [45, 83]"
    assert claims[-2].own == "1,000 on one core"


def test_the_papers_table_one_reproduces_itself():
    paper = network(interval(14 / 21, 0.45, 0.83), interval(0.763, 0.58, 0.99))
    verdicts = {claim.verdict for claim in table_one_claims({"model32": paper})}
    assert verdicts == {"too few maps to say", "reproduced"}


def test_slower_fewer_or_farther_is_worse_than_the_paper():
    whole = {"cpu_seconds": 60.0, "kept": 0.0, "pairs": 1000}
    seconds = {"ekf_64": [0.1], "ekf_64_to_256": [0.1], "two_phase": [0.5]}
    nearness_found = nearer([2.0] * 9, [1.0] * 9)
    nothing = {"methods": {}, "realism": None}
    found = Findings(nothing, nothing, {"whole": whole}, seconds, nearness_found)
    claims = judge_claims(found)
    assert len(claims) == 6
    assert {claim.verdict for claim in claims} == {"worse than the paper"}


def test_table_one_stands_beside_the_papers():
    headings, rows = table_one_beside(PROTOCOL["methods"], ERRORS)
    assert {len(row) for row in rows} == {len(headings)}
    assert rows[0][1:6] == ["21", "0.114 (0.028-0.339)", "0.087", "0.76", "14 of 21: 67 % [45, 83]"]
    assert [row[0] for row in rows[1:]] == [RAW, THICKENED, "model32", "slam2cad"]
    assert rows[2][4] == "0.56 [0.48, 0.64]"
    assert rows[3][2:] == [
        "0.050 (0.018-0.200)", "0.040", "0.90 [0.85, 0.95]", "110 of 200: 55 % [48, 62]",
        "0.60 [0.50, 0.70]", "1.00 [0.50, 1.50]",
    ]  # fmt: skip


def test_errors_are_given_by_coverage_and_alignment():
    headings, rows = alignment_table(ERRORS)
    assert {len(row) for row in rows} == {len(headings)}
    assert [row[:2] for row in rows] == [
        ["0.7 to 0.8", "1"], ["0.8 to 0.9", "1"], ["0.95 to 1", "2"], ["all", "4"],
    ]  # fmt: skip
    means = [float(cell.split()[0]) for cell in rows[-1][2:5]]
    assert means == [0.25, 0.175, 0.092]
    assert rows[-1][5] == "0.018-0.200"


def write_pair(folder, name, cad, slam):
    for side, image in (("A", cad), ("B", slam)):
        (folder / "test" / side).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / "test" / side / f"{name}.png"), image)


def test_map_errors_are_read_with_their_coverage(tmp_path, monkeypatch):
    cad = np.zeros((8, 8), np.uint8)
    cad[2:6, 2:6] = 254
    slam = np.full((8, 8), 205, np.uint8)
    slam[2:6, 2:5] = 254
    write_pair(tmp_path, "0", cad, slam)
    record = SimpleNamespace(name="0", split="test", size=8, coverage=0.75, group="flat")
    monkeypatch.setattr(protocol, "read_images", lambda *_: [record])
    text = f"method,name,plan_id,mse,mse_rigid\n{RAW},0,flat,0.01,0.02\nmodel32,0,flat,0.5,0.5\n"
    (tmp_path / "scores.csv").write_text(text)
    errors = protocol.read_map_errors(tmp_path, tmp_path)
    assert errors.unaligned.tolist() == [4 / 64]
    assert (errors.rigid.tolist(), errors.similarity.tolist()) == ([0.02], [0.01])
    assert (errors.coverage.tolist(), errors.plans) == ([0.75], ["flat"])


def test_the_conversions_are_timed_by_their_folders():
    seconds = read_seconds(DEFORMED)
    # The first map waits for its kernels; where it is the only one, it counts.
    assert seconds == {
        "ekf_64": [1.5, 1.9],
        "ekf_64_to_256": [2.0],
        "two_phase": [0.1, 0.1],
        "elastic": [],
    }
    headings, rows = table_two(seconds)
    assert {len(row) for row in rows} == {len(headings)}
    assert [row[3] for row in rows] == ["1.5-1.9", "2", "0.1", "not timed"]
    assert {"ekf_64", "ekf_64_to_256", "two_phase", "ekf_schur"} == {c.folder for c in CONVERSIONS}
    made = " ".join(" ".join(STEPS["deformed"]).split())
    for conversion in CONVERSIONS:
        assert f"--out {{out}}/deformed/{conversion.folder} " in made


def test_no_verdict_takes_our_own_conversion_for_the_papers():
    seconds = {conversion.folder: [0.1] for conversion in CONVERSIONS}
    questions = [claim.question for claim in conversion_claims(seconds)]
    assert len(questions) == 2
    assert not any(OURS.folder in question for question in questions)
    assert conversion_claims({OURS.folder: [0.1], TWO_PHASE.folder: [0.05]}) == []
    assert [EKF_A.name in questions[0], EKF_B.name in questions[1]] == [True, True]


def test_parametric_maps_are_compared_with_the_networks_pair_by_pair():
    few = nearness_claims(nearer([1.0, 3.0], [2.0, 2.0]))
    assert {claim.verdict for claim in few} == {"too few maps to say"}
    assert {claim.own for claim in few} == {"1 of 2: 50 % [9, 91]"}
    assert nearness_claims(None) == []


def test_walls_lie_as_far_apart_as_they_were_moved():
    here = np.full((9, 9), 254, np.uint8)
    here[:, 2] = 0
    there = np.roll(here, 3, axis=1)
    assert wall_distance(here, there) == 3.0
    assert wall_distance(here, here) == 0.0
    assert wall_distance(here, np.full_like(here, 254)) == pytest.approx(9 * np.sqrt(2))


def test_maps_of_several_frames_are_laid_over_each_other(tmp_path, monkeypatch):
    """A map frame lies about the robot's own start: the same walls from another start are as near as can be."""
    from slamgym.core.types import GridFrame, OccupancyGrid
    from slamgym.interop import write_ros_map

    cells = np.full((20, 20), 205, np.uint8)
    cells[5:15, 5:15] = 0
    cells[6:14, 6:14] = 254
    starts = {
        "pairs": (0.5, 0.5, 0.0),
        "parametric": (1.0, 2.0, 0.0),
        "generator": (0.5, 0.5, 0.0),
        "modelprog": (3.0, 1.0, 0.0),
    }
    for method in (*REDRAWN, "modelprog"):
        x, y, _ = starts[method]
        frame = GridFrame(0.1, -1.0 - x, -1.0 - y, 20, 20)
        folder = tmp_path / method / "episodes" / "0"
        folder.mkdir(parents=True)
        write_ros_map(folder, OccupancyGrid(cells, frame))
    monkeypatch.setattr(
        nearness, "read_manifest", lambda root: [SimpleNamespace(name="0", start=starts[root.name])]
    )
    image = SimpleNamespace(
        name="0", group="flat", frame=GridFrame(0.1, -1.5, -1.5, 20, 20), metres_per_px=0.1
    )
    monkeypatch.setattr(nearness, "read_images", lambda *_: [image])
    monkeypatch.setattr(nearness, "load_images", lambda *_: (cells, cells))
    found = nearness.measure_nearness(tmp_path / "pairs", tmp_path, tmp_path)
    assert found.plans == ["flat"]
    assert {values.tolist()[0] for values in found.errors.values()} == {0.0}
    assert {values.tolist()[0] for values in found.wall_distances.values()} == {0.0}


def test_own_claims_compare_with_the_map_and_with_its_thickened_walls():
    def scored(**values):
        return [
            {"plan_id": f"{n}"}
            | {measure.name: f"{values.get(measure.name, 0.5)}" for measure in OWN_MEASURES}
            for n in range(8)
        ]

    scores = {
        RAW: scored(mse=0.2, wall_f1_10cm=0.6),
        THICKENED: scored(mse=0.1, wall_f1_10cm=0.3),
        "slam2cad": scored(mse=0.15, wall_f1_10cm=0.8),
    }
    headings, rows = own_claims(scores)
    assert {len(row) for row in rows} == {len(headings)}
    words = {row[1]: row[-2:] for row in rows}
    assert words["aligned MSE"] == ["better", "worse"]
    assert words["wall F1 10 cm"] == ["better", "better"]
    assert words["room count error"] == ["too few maps to say"] * 2


def test_losses_are_shown_where_a_run_trained_and_missed_honestly_elsewhere(tmp_path):
    networks = ("model32", "modelprog")
    (said,) = figures.paper_figures(tmp_path, networks)
    assert "no losses" in said
    assert "Figure 4" in said
    for network_name in networks:
        path = tmp_path / figures.LOSSES.format(network=network_name)
        path.parent.mkdir(parents=True)
        assert (
            f"{network_name} was trained too short" in figures.paper_figures(tmp_path, networks)[-1]
        )
        cv2.imwrite(str(path), np.zeros((4, 4), np.uint8))
    shown = figures.paper_figures(tmp_path, networks)
    assert ["model32" in shown[0], "modelprog" in shown[1]] == [True, True]
    assert all("<img" in picture for picture in shown)


@pytest.mark.parametrize("opacity", [(), (255,)])
def test_pictures_keep_their_colours(tmp_path, opacity):
    """A plot has a fourth channel, which is no colour."""
    red = (0, 0, 255, *opacity)
    cv2.imwrite(str(tmp_path / "plot.png"), np.full((4, 4, len(red)), red, np.uint8))
    (shown,) = figures.pictures(tmp_path, [figures.CaptionedPicture("plot.png", "A plot.")])
    encoded = base64.b64decode(shown.partition("base64,")[2].partition('"')[0])
    pixels = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_UNCHANGED)
    assert pixels[0, 0].tolist() == [0, 0, 255]


def test_every_picture_is_made_by_a_step_and_none_of_maps_is_called_figure_4():
    made = " ".join(" ".join(lines) for lines in STEPS.values())
    for picture in (*figures.PAPER_FIGURES, *figures.OTHER_FIGURES):
        folder = picture.pattern.rpartition("/")[0]
        is_sheet = folder == "deformed"
        wanted = (
            f"--out {{out}}/{picture.pattern}"
            if is_sheet
            else f"{{out}}/{folder.removesuffix('/**')}"
        )
        assert wanted in made or picture.pattern == figures.NEARNESS
        assert "Figure 4" not in picture.caption
    captions = " ".join(picture.caption for picture in figures.PAPER_FIGURES)
    assert all(f"Figure {number}" in captions for number in range(5, 10))


def test_without_houseexpo_the_command_says_where_it_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["reproduce", "--scale", "laptop", "--out", "out"]) == 2
    assert "slamgym plans fetch houseexpo" in capsys.readouterr().err

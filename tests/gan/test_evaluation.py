"""The evaluation on drawings whose answers are known, and its command from end to end."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
from shapely import box, unary_union
from shapely.affinity import rotate, translate

from slamgym.cad.floorplan import floor_share
from slamgym.commands.cli import TABLE
from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN, GridFrame, OccupancyGrid
from slamgym.gan.data import PairSet
from slamgym.gan.evaluation.evaluate import (
    BLURRED,
    CLEANED,
    OUTLINE_ONLY,
    RAW,
    THICKENED,
    TranslationMethod,
    baselines,
    evaluate_method,
    evenly_spaced,
    learned,
    score_map,
)
from slamgym.gan.evaluation.generated_maps import (
    load_generated,
    parse_named_folders,
    translated_maps,
)
from slamgym.gan.evaluation.summary import main_table, scores_csv, summarise_scores, table_one
from slamgym.gan.translation.classical import outline_only, thickened_walls, wall_growth
from slamgym.gan.translation.elastic import bend_with_field
from slamgym.gan.translation.translate import Translator
from slamgym.interop import write_ros_map
from slamgym.metrics import Similarity, apply_similarity, label_rooms
from slamgym.metrics.cleaning import clean_map
from slamgym.metrics.maps import keep_thin_walls
from slamgym.viz.plots import plot_boxes
from slamgym.viz.sheets import draw_agreement, draw_grid


def main(argv):
    return TABLE.run("slamgym", ["gan", "evaluate", *map(str, argv)])


SCALE = 0.08
SIZE = 128


def plan(width: int = 80, wall: int = 50):
    """A CAD map: three rooms with doorways of 0.96 m."""
    cad = np.zeros((SIZE, SIZE), np.uint8)
    cad[20:100, 20 : 20 + width] = FREE
    cad[20:100, wall : wall + 2] = OCCUPIED
    cad[35:47, wall : wall + 2] = FREE
    cad[60:62, wall:] = OCCUPIED
    cad[60:62, wall + 14 : wall + 26] = np.where(wall + 14 < 20 + width, FREE, OCCUPIED)
    return cad


def explored(cad, rng, rays: int = 12):
    """A SLAM map of it: faces of walls one pixel thick, unknown behind, rays that left, specks of furniture."""
    free = (cad > 127).astype(np.uint8)
    slam = np.full(cad.shape, UNKNOWN, np.uint8)
    slam[cv2.dilate(free, np.ones((3, 3), np.uint8)) > 0] = OCCUPIED
    slam[free > 0] = FREE
    for row in rng.choice(
        np.arange(22, 98, 4), rays, replace=False
    ):  # apart: beside each other they are wide
        slam[row, 101 : 101 + int(rng.integers(5, 25))] = FREE
        slam[row, 100] = FREE
    for _ in range(4):
        row, col = rng.integers(25, 95), rng.integers(55, 95)
        slam[row : row + 2, col : col + 2] = OCCUPIED
    return slam


def make_pairs(count: int) -> PairSet:
    rng = np.random.default_rng(0)
    cad = np.stack([plan(72 + i % 9, 44 + i % 7) for i in range(count)])
    slam = np.stack([explored(image, rng) for image in cad])
    names = tuple(f"{i:03d}" for i in range(count))
    return PairSet(cad, slam, names, tuple(f"plan{i}" for i in range(count)), np.full(count, SCALE))


def write_pairs(root, pairs: PairSet) -> None:
    lines = []
    for side in "AB":
        (root / "test" / side).mkdir(parents=True)
    for i, name in enumerate(pairs.names):
        cv2.imwrite(str(root / "test" / "A" / f"{name}.png"), pairs.cad[i])
        cv2.imwrite(str(root / "test" / "B" / f"{name}.png"), pairs.slam[i])
        record = {
            "name": name,
            "split": "test",
            "plan_id": pairs.plan_ids[i],
            "metres_per_px": SCALE,
        }
        lines.append(json.dumps(record))
    (root / "manifest.jsonl").write_text("\n".join(lines) + "\n")


def copying_translator(side: int):
    """A CAD-to-SLAM translator that draws floor and walls where the CAD map has them."""
    torch = pytest.importorskip("torch")
    from slamgym.gan.config import TranslatorConfig
    from slamgym.gan.device import choose_compute
    from slamgym.gan.networks.factory import on_device
    from slamgym.gan.networks.generators import GeneratorOutput
    from slamgym.gan.translation.translate import LearnedTranslator
    from slamgym.gan.weights import ModelCard

    class Copy(torch.nn.Module):
        def forward(self, x, resolution=None, fade=1.0):
            return GeneratorOutput(x)

    config = TranslatorConfig(
        direction="cad2slam", input_size=side, output_size=side, input_encoding="free_occupied",
        output_encoding="free_occupied",
    )  # fmt: skip
    return LearnedTranslator(
        on_device(Copy(), config, choose_compute("cpu", "float32")), config, ModelCard()
    )


@pytest.fixture
def few_trees(monkeypatch):
    """A tenth of the trees."""
    ensemble = pytest.importorskip("sklearn.ensemble")
    whole = ensemble.ExtraTreesClassifier
    monkeypatch.setattr(
        ensemble, "ExtraTreesClassifier", lambda _, **settings: whole(50, **settings)
    )


@pytest.fixture(scope="module")
def scored():
    """Six pairs and what the baselines make of them: measured once, for the tests that only read it."""
    pairs = make_pairs(6)
    return pairs, {method.name: evaluate_method(method, pairs) for method in baselines()}


def thin(wall, turn=0.0, shift=(0.0, 0.0), hole=0.0):
    """Shares of floor of two rooms with a door, and a hole, in a wall of this thickness [m], turned [deg] and moved."""
    gaps = [box(-0.5, -2.0, 0.5, -1.0), box(-0.5, 1.0, 0.5, 1.0 + hole)]
    rooms = [box(-4.1, -3.2, -wall / 2, 3.3), box(wall / 2, -3.2, 4.2, 3.3), *gaps]
    moved = translate(rotate(unary_union(rooms), turn, origin=(0.0, 0.0)), *shift)
    corners = np.array(moved.exterior.coords)
    return floor_share(
        np.hstack([corners[:-1], corners[1:]]), GridFrame(0.1, -6.4, -6.4, SIZE, SIZE)
    )


class TestThinWalls:
    """What the alignment resamples is neither opened nor moved by it."""

    @pytest.mark.parametrize("wall", [0.07, 0.1, 0.13])
    @pytest.mark.parametrize(
        "motion", [(0.0, (0.05, 0.0)), (1.0, (0.03, 0.02)), (3.0, (-0.04, 0.05))]
    )
    def test_a_plan_that_is_drawn_elsewhere_has_no_wall_opened(self, wall, motion):
        cad = np.rint(FREE * thin(wall)).astype(np.uint8)
        found = score_map(thin(wall, *motion), cad, 0.1)
        assert (found.openings.walls, found.openings.walls_opened, found.openings.doors_kept) == (
            1,
            0,
            1,
        )
        # A wall of a cell or so is known to a third of a cell.
        assert abs(np.median(found.dimensions.room_width)) < 0.035
        assert score_map(thin(wall, *motion, hole=0.7), cad, 0.1).openings.walls_opened == 1

    def test_faces_of_thick_walls_stay_where_they_are(self):
        drawing = np.zeros((SIZE, SIZE), np.float32)
        drawing[20:60, 20:100] = drawing[66:100, 20:100] = 1.0
        drawing = cv2.GaussianBlur(drawing, (0, 0), 0.7)
        for angle, shift in ((0.0, 0.004), (0.02, 0.002), (-0.05, 0.001)):
            motion = Similarity(shift, -shift, angle, 0.0)
            moved = apply_similarity(drawing.astype(np.float64), motion).astype(np.float32)
            kept = keep_thin_walls(moved, drawing, motion.matrix(SIZE, SIZE))
            assert np.array_equal(kept, moved), angle


class TestScores:
    def test_the_cad_map_itself_is_perfect(self):
        score = score_map(plan() > 127, plan(), SCALE)
        assert (score.mse, score["wall_f1_10cm"], score["free_iou"], score["room_error"]) == (
            0.0,
            1.0,
            1.0,
            0,
        )

    def test_a_turned_map_is_measured_after_alignment(self):
        matrix = cv2.getRotationMatrix2D((63.5, 63.5), 12.0, 1.05)
        turned = cv2.warpAffine(plan(), matrix, (SIZE, SIZE)) > 127
        score = score_map(turned, plan(), SCALE)
        assert score.mse < 0.2 * np.mean(turned != (plan() > 127))
        assert score["wall_f1_10cm"] > 0.9

    def test_the_outline_beats_the_map_in_the_error_and_is_exposed_by_walls_and_rooms(self, scored):
        _, scores = scored
        mean = {
            name: {k: np.mean([s[k] for s in rows]) for k in ("mse", "wall_f1_10cm", "room_error")}
            for name, rows in scores.items()
        }
        assert (
            mean[OUTLINE_ONLY]["wall_f1_10cm"]
            < mean[RAW]["wall_f1_10cm"]
            < mean[CLEANED]["wall_f1_10cm"]
        )
        assert mean[OUTLINE_ONLY]["room_error"] >= 1.5
        assert mean[CLEANED]["mse"] < mean[RAW]["mse"]
        assert mean[CLEANED]["room_error"] == 0.0

    def test_greys_are_measured_as_they_are_and_as_a_mask(self):
        cad = plan()
        sure = score_map((cad > 127).astype(np.float32), cad, SCALE)
        unsure = score_map(np.where(cad > 127, 0.6, 0.4).astype(np.float32), cad, SCALE)
        assert (sure.mse, sure["mse_grey"]) == (0.0, 0.0)
        assert unsure.mse == 0.0
        assert unsure["wall_f1_10cm"] == 1.0
        assert unsure["mse_grey"] == pytest.approx(0.16)

    def test_a_map_with_displaced_walls_gains_by_greys_alone(self):
        pairs = make_pairs(1)
        slam, _ = bend_with_field(pairs.cad[0], SCALE, np.random.default_rng(0))
        bent = dataclasses.replace(pairs, slam=slam[np.newaxis])
        raw, blurred = (
            evaluate_method(method, bent)[0]
            for method in baselines()
            if method.name in (RAW, BLURRED)
        )
        assert raw["mse_grey"] == pytest.approx(raw.mse)
        assert blurred["mse_grey"] < 0.95 * raw.mse

    def test_an_empty_translation_is_finite_and_bad(self):
        score = score_map(np.zeros((SIZE, SIZE), bool), plan(), SCALE)
        assert score["wall_f1_10cm"] == score["free_iou"] == 0.0
        assert np.isfinite(score["hausdorff_95"])

    def test_malformed_translations_and_unknown_scales_are_refused(self):
        pairs = make_pairs(1)
        with pytest.raises(ConfigError, match="shape"):
            evaluate_method(
                TranslationMethod("small", lambda pairs, i: np.zeros((4, 4), np.float32)), pairs
            )
        with pytest.raises(ConfigError, match="not finite"):
            evaluate_method(
                TranslationMethod(
                    "nan", lambda pairs, i: np.full((SIZE, SIZE), np.nan, np.float32)
                ),
                pairs,
            )
        unknown = PairSet(pairs.cad, pairs.slam, pairs.names, pairs.plan_ids, np.array([np.nan]))
        with pytest.raises(ConfigError, match="no scale"):
            evaluate_method(baselines()[0], unknown)

    def test_a_translator_is_asked_with_the_slam_map(self):
        class Answers:
            def translate(self, slam, metres_per_px=None):
                return (slam == FREE).astype(np.float32)

        assert isinstance(Answers(), Translator)
        pairs = make_pairs(2)
        mine, raw = (
            evaluate_method(m, pairs) for m in (learned("mine", Answers()), baselines()[0])
        )
        assert [s.mse for s in mine] == [s.mse for s in raw]


class TestCleaning:
    def test_thin_walls_stay_and_rays_and_specks_go(self):
        rng = np.random.default_rng(1)
        cleaned = clean_map(explored(plan(), rng), SCALE)
        assert label_rooms(cleaned, SCALE).max() == label_rooms(plan() > 127, SCALE).max() == 3
        assert not cleaned[:, 104:].any()
        assert np.mean(cleaned == (plan() > 127)) > 0.985

    def test_sizes_are_in_metres(self):
        slam = explored(plan(), np.random.default_rng(1))
        large = np.repeat(np.repeat(slam, 2, axis=0), 2, axis=1)
        small = clean_map(slam, SCALE)
        assert np.mean(clean_map(large, SCALE / 2)[::2, ::2] == small) > 0.99

    def test_what_fits_into_a_square_is_furniture_and_what_is_longer_a_wall(self):
        slam = np.full((120, 120), UNKNOWN, np.uint8)
        slam[10:110, 10:110] = FREE
        slam[20:30, 20:30] = OCCUPIED  # 0.5 m square
        slam[80:84, 30:90] = slam[20:70, 60:64] = OCCUPIED  # 3 and 2.5 m long, standing free
        cleaned = clean_map(slam, 0.05)
        assert cleaned[15:35, 15:35].all()
        assert not cleaned[80:84, 30:90].any()
        assert not cleaned[20:70, 60:64].any()

    def test_an_empty_and_an_unknown_map_stay_empty(self):
        for value in (OCCUPIED, UNKNOWN):
            assert not clean_map(np.full((40, 50), value, np.uint8), 0.05).any()

    def test_walls_are_thickened_to_those_of_the_target_and_no_more(self):
        cad = np.full((80, 120), OCCUPIED, np.uint8)
        cad[10:70, 10:50] = cad[10:70, 60:110] = FREE  # a wall of 10 px
        slam = np.full((80, 120), UNKNOWN, np.uint8)
        slam[9:71, 9:111] = OCCUPIED
        slam[10:70, 10:53] = slam[10:70, 57:110] = FREE  # of 4 px
        assert wall_growth(cad, slam, SCALE) == 3.0
        thick = thickened_walls(slam, 3.0)
        assert np.flatnonzero(thick[30]).tolist() == [*range(13, 50), *range(60, 107)]
        assert np.array_equal(thickened_walls(slam, 0.0), slam == FREE)
        assert wall_growth(slam, cad, SCALE) == 0.0  # never thinner
        nothing = np.full((80, 120), UNKNOWN, np.uint8)
        assert wall_growth(cad, nothing, SCALE) == 0.0

    def test_thick_walls_buy_error_on_thick_targets_but_no_rooms(self):
        thin = plan()
        floor = cv2.erode((thin == FREE).astype(np.uint8), np.ones((7, 7), np.uint8))
        cad = np.where(floor > 0, FREE, OCCUPIED).astype(np.uint8)
        slam = explored(thin, np.random.default_rng(0))
        names, scales = ("a",), np.array([SCALE])
        pairs = PairSet(cad[None], slam[None], names, names, scales)
        raw, _, thickened, *_ = (evaluate_method(method, pairs)[0] for method in baselines())
        assert thickened["mse"] < 0.8 * raw["mse"]
        assert thickened["room_f1"] <= raw["room_f1"] + 0.35

    def test_the_outline_has_no_inner_wall_and_keeps_the_outer_ones(self):
        outline = outline_only(plan(), SCALE)
        assert label_rooms(outline, SCALE).max() == 1
        assert np.array_equal(outline[:, :20], np.zeros((SIZE, 20), bool))
        assert outline[20:100, 20:100].all()
        # A building that reaches the border of its image is not joined to it.
        assert outline_only(plan()[20:, 20:], SCALE).sum() == outline.sum()


class TestTables:
    def test_the_summary_compares_every_method_with_the_raw_map(self, scored):
        pairs, scores = scored
        summary = summarise_scores(scores)
        assert json.loads(json.dumps(summary)) == summary
        assert "improvement" not in summary[RAW]
        better, grey = summary[CLEANED]["improvement"], summary[BLURRED]["improvement_grey"]
        assert grey["mean_mse1"]["value"] == pytest.approx(
            np.mean([s["mse_grey"] for s in scores[BLURRED]])
        )
        assert better["mean_mse2"]["value"] == pytest.approx(summary[RAW]["mse"]["value"])
        expected = np.mean(
            [a.mse < b.mse for a, b in zip(scores[CLEANED], scores[RAW], strict=True)]
        )
        assert better["share_improved"]["value"] == pytest.approx(expected)
        headings, rows = main_table(summary)
        assert [row[0] for row in rows] == [RAW, BLURRED, THICKENED, CLEANED, OUTLINE_ONLY]
        assert all(len(row) == len(headings) for row in rows)
        headings, rows = table_one(scores)
        assert len(rows) == len(pairs) + 1
        assert rows[-1][0] == "mean"
        of_table = summary[CLEANED]["improvement_table_one"]
        assert of_table["count"] == len(rows) - 1
        mean = dict(zip(headings, rows[-1], strict=True))[f"MSE1: {CLEANED}"]
        assert of_table["mean_mse1"]["value"] == pytest.approx(float(mean), abs=1e-4)
        assert len(scores_csv(scores).splitlines()) == 1 + 5 * len(pairs)

    def test_the_choice_of_maps_is_even_and_never_twice(self):
        assert evenly_spaced(10, 4) == [0, 3, 6, 9]
        assert evenly_spaced(3, 20) == [0, 1, 2]
        assert evenly_spaced(0, 5) == []


class TestRealism:
    def test_a_translator_draws_cad_maps_as_they_are_and_bent(self):
        translator = copying_translator(128)
        pairs = make_pairs(2)
        made = translated_maps("copy", translator, pairs, seed=0)
        assert list(made) == ["copy", "copy, bent"]
        # What it draws is its input: the CAD map as it is, and displaced by a tenth of a room.
        for cad, same, other in zip(
            pairs.cad, made["copy"].values(), made["copy, bent"].values(), strict=True
        ):
            assert np.array_equal(same, translator.translate_cells(cad, SCALE))
            assert 0.005 < np.mean((other == FREE) != (same == FREE)) < 0.2
        again, other = (
            translated_maps("copy", translator, pairs, seed)["copy, bent"] for seed in (0, 1)
        )
        assert np.array_equal(again[1], made["copy, bent"][1])
        assert not np.array_equal(other[1], again[1])

    def test_bending_displaces_walls_and_keeps_the_values(self):
        cad = plan()
        bent, _ = bend_with_field(cad, SCALE, np.random.default_rng(0))
        assert set(np.unique(bent)) == {OCCUPIED, UNKNOWN, FREE}
        assert 0.01 < np.mean((bent == FREE) != (cad == FREE)) < 0.2


class TestGeneratedMaps:
    def test_images_and_ros_maps_are_found_by_the_names_of_the_pairs(self, tmp_path):
        pairs = make_pairs(12)
        for i in range(6):
            cv2.imwrite(str(tmp_path / f"{pairs.names[i]}.png"), pairs.slam[i])
        for i in range(6, 12):
            # As `slamgym deform` writes: another scale, another place in the image.
            folder = tmp_path / pairs.names[i] / "000"
            folder.mkdir(parents=True)
            cells = np.repeat(np.repeat(pairs.slam[i][10:], 2, axis=0), 2, axis=1)
            frame = GridFrame(SCALE / 2, 0.0, 0.0, *cells.shape)
            write_ros_map(folder, OccupancyGrid(cells, frame))
        maps = load_generated(tmp_path, pairs)
        assert list(maps) == list(range(12))
        assert all(np.array_equal(maps[i], pairs.slam[i]) for i in range(6))
        assert all(np.mean(maps[i] == pairs.slam[i][10:]) > 0.97 for i in range(6, 12))

    def test_too_few_and_malformed_arguments_are_refused(self, tmp_path):
        with pytest.raises(InputFileError, match="no map of a test pair"):
            load_generated(tmp_path, make_pairs(3))
        with pytest.raises(ConfigError, match="NAME=FOLDER"):
            parse_named_folders(["modelprog"])
        with pytest.raises(InputFileError, match="not a folder"):
            parse_named_folders([f"a={tmp_path / 'none'}"])
        with pytest.raises(ConfigError, match="twice"):
            parse_named_folders([f"a={tmp_path}", f"a={tmp_path}"])


class TestPictures:
    def test_grids_and_overlays(self):
        rows = [[plan(), plan()]] * 3
        one = draw_grid(["a", "b"], rows, ["x", "y", "z"])
        many = draw_grid(["a", "b"], rows * 4)
        assert one.dtype == np.uint8
        assert many.shape[1] > 1.9 * one.shape[1]  # two blocks
        overlay = draw_agreement(
            np.array([[True, True, False, False]]), np.array([[True, False, True, False]])
        )
        assert len({tuple(pixel) for pixel in overlay[0]}) == 4

    def test_the_box_plot_is_a_picture(self, tmp_path):
        pytest.importorskip("matplotlib")
        plot_boxes(tmp_path / "box.png", {"a": np.random.default_rng(0).normal(size=30)}, "label")
        assert cv2.imread(str(tmp_path / "box.png")).shape[2] == 3


class TestCommand:
    @pytest.mark.usefixtures("few_trees")
    def test_from_images_to_tables_and_pictures(self, tmp_path, capsys):
        pytest.importorskip("matplotlib")
        pytest.importorskip("sklearn")
        pairs = make_pairs(10)
        images, out, made, bent = (tmp_path / name for name in ("images", "out", "made", "bent"))
        write_pairs(images, pairs)
        for folder in (made, bent):
            folder.mkdir()
        for i, name in enumerate(pairs.names):
            cv2.imwrite(str(made / f"{name}.png"), pairs.slam[i])
            cells, _ = bend_with_field(pairs.cad[i], SCALE, np.random.default_rng(i))
            cv2.imwrite(str(bent / f"{name}.png"), cells)
        arguments = [str(images), "-o", str(out), "--pictures", "1"]
        arguments += ["--generated", f"bent={bent}", f"copied={made}", "--repeats", "1"]
        assert main(arguments) == 0
        assert "improved" in capsys.readouterr().out
        result = json.loads((out / "evaluation.json").read_text())
        assert result["maps"] == 10
        assert result["metres_per_px"]["p50"] == pytest.approx(SCALE)
        found = {test["second"]: test["accuracy"]["value"] for test in result["realism"]["tests"]}
        assert list(found) == ["simulated", "bent", "copied"]
        assert found["bent"] > 0.9 > found["simulated"]
        for row in result["realism"]["statistics"]:
            assert row["medians"]["copied"]["value"] == row["medians"]["simulated"]["value"]
        assert "Table I" in (out / "tables.md").read_text()
        for picture in ("maps.png", "overlays.png", "differences.png", "cad2slam.png"):
            assert cv2.imread(str(out / picture)) is not None

    def test_the_same_command_gives_the_same_figures(self, tmp_path):
        write_pairs(tmp_path / "images", make_pairs(3))
        found = []
        for run in ("a", "b"):
            main(
                [
                    str(tmp_path / "images"),
                    "-o",
                    str(tmp_path / run),
                    "--pictures",
                    "0",
                    "--count",
                    "2",
                ]
            )
            result = json.loads((tmp_path / run / "evaluation.json").read_text())
            for method in result["methods"].values():
                del method["seconds"]
            found.append(result)
        assert found[0] == found[1]
        assert found[0]["maps"] == 2

    @pytest.mark.parametrize(
        ("extra", "message"),
        [
            (["--size", "8"], "--size must be 0 or at least 32, not 8"),
            (["--count", "-1"], "--count must be at least 0, not -1"),
            (["--weights", "none-such-weights"], "none-such-weights"),
            (["--weights", f"{BLURRED}=slam2cad"], "two methods"),
            (["--generated", "a"], "NAME=FOLDER"),
            (["--split", "valid"], "valid"),
        ],
    )
    def test_mistakes_are_one_clear_error(self, tmp_path, extra, message):
        if "--weights" in extra:
            pytest.importorskip("torch")
        write_pairs(tmp_path / "images", make_pairs(2))
        with pytest.raises((ConfigError, InputFileError), match=message):
            main([str(tmp_path / "images"), "-o", str(tmp_path / "out"), *extra])

    def test_a_missing_folder_is_one_clear_error(self, tmp_path):
        with pytest.raises(InputFileError, match="dataset render"):
            main([str(tmp_path / "none"), "-o", str(tmp_path / "out")])

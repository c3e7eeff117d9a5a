"""Folders of pairs: what is read, what is refused; encodings, resampling and the stream of batches."""

import dataclasses
import json

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.types import FREE, OCCUPIED, UNKNOWN
from slamgym.gan.data import PairSet, describe_data, face_lines, load_pairs, load_training_pairs
from slamgym.gan.encoding import decode_slam, encode, enlarge_means, free_probability
from slamgym.gan.pair_files import image_side, read_grey
from slamgym.gan.presets import find_preset
from slamgym.gan.training.sampler import BatchSampler
from slamgym.metrics.maps import resample_slam


def test_rendered_folders_and_plain_ones_read_alike(tmp_path, make_images):
    split = load_pairs(make_images(tmp_path / "split", manifest=True), "train", 32)
    plain = load_pairs(make_images(tmp_path / "plain", split=""), "train", 32)
    assert np.array_equal(split.slam, plain.slam)
    assert split.plan_ids == ("p0", "p0", "p1", "p1", "p2", "p2")
    assert plain.plan_ids == plain.names
    assert np.isnan(plain.metres_per_px).all()
    assert set(np.unique(split.slam)) == {OCCUPIED, UNKNOWN, FREE}


def test_resampled_images_keep_their_scale_in_metres(tmp_path, make_images):
    pairs = load_pairs(make_images(tmp_path, manifest=True), "train", 16)
    assert pairs.cad.shape == (6, 16, 16)
    assert pairs.metres_per_px == pytest.approx(np.full(6, 0.2))
    assert pairs.scale_percentiles() == pytest.approx((0.2, 0.2, 0.2))


def test_near_duplicates_count_as_one_plan(tmp_path, make_images):
    make_images(tmp_path)
    rows = [
        {"name": f"{i:03d}", "plan_id": f"p{i}", "group": "g", "metres_per_px": 0.1}
        for i in range(6)
    ]
    (tmp_path / "manifest.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert set(load_pairs(tmp_path, "train", 32).plan_ids) == {"g"}


def test_a_split_never_tears_a_plan_apart(tmp_path, make_images):
    pairs = load_pairs(make_images(tmp_path, count=40, manifest=True), "train", 32)
    rest, held_out = pairs.split(0.4)
    assert len(rest) + len(held_out) == 40
    assert len(rest) > 0
    assert len(held_out) > 0
    assert not set(rest.plan_ids) & set(held_out.plan_ids)


def record(root, names, plans):
    rows = [
        {"name": name, "plan_id": plan, "metres_per_px": 0.1}
        for name, plan in zip(names, plans, strict=True)
    ]
    (root / "manifest.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


def test_folders_are_learned_from_together_but_for_each_others_test_plans(tmp_path, make_images):
    first, second = (make_images(tmp_path / name, count=3) for name in ("first", "second"))
    make_images(first, count=2, split="test")
    (first / "test").joinpath("A", "000.png").rename(first / "test" / "A" / "t0.png")
    (first / "test").joinpath("B", "000.png").rename(first / "test" / "B" / "t0.png")
    for side in "AB":
        (first / "test" / side / "001.png").unlink()
    (second / "test" / "A").mkdir(parents=True)  # too few plans for a test side
    record(first, ["000", "001", "002", "t0"], ["p0", "p1", "p2", "tested"])
    record(second, ["000", "001", "002"], ["p0", "tested", "p3"])
    together = load_training_pairs([first, second], 32)
    assert together.plan_ids == ("p0", "p1", "p2", "p0", "p3")
    assert np.array_equal(together.slam[:3], load_pairs(first, "train", 32).slam)
    assert np.array_equal(together.cad[3:], load_pairs(second, "train", 32).cad[[0, 2]])
    record(second, ["000", "001", "002"], ["tested"] * 3)
    with pytest.raises(InputFileError, match="second: has only plans that are on the test side"):
        load_training_pairs([first, second], 32)


def break_nothing_there(root):
    return root / "absent"


def break_no_sides(root):
    (root / "empty").mkdir()
    return root / "empty"


def break_no_images(root):
    for path in root.rglob("*.png"):
        path.unlink()
    return root


def break_explorations(root):
    (root / "episodes").mkdir()
    return root


def break_missing_file(root):
    (root / "train" / "B" / "003.png").unlink()
    return root


def break_side_missing(root):
    for path in (root / "train" / "A").iterdir():
        path.unlink()
    (root / "train" / "A").rmdir()
    return root


def break_shape_of_b(root):
    cv2.imwrite(str(root / "train" / "B" / "003.png"), np.zeros((32, 40), np.uint8))
    return root


def break_not_square(root):
    for side in "AB":
        cv2.imwrite(str(root / "train" / side / "000.png"), np.zeros((32, 40), np.uint8))
    return root


def break_other_size(root):
    for side in "AB":
        cv2.imwrite(str(root / "train" / side / "003.png"), np.zeros((64, 64), np.uint8))
    return root


def break_colour(root):
    image = np.zeros((32, 32, 3), np.uint8)
    image[..., 2] = 200
    cv2.imwrite(str(root / "train" / "A" / "003.png"), image)
    return root


def break_depth(root):
    cv2.imwrite(str(root / "train" / "A" / "003.png"), np.zeros((32, 32), np.uint16))
    return root


def break_garbage(root):
    (root / "train" / "A" / "003.png").write_bytes(b"no picture")
    return root


def break_name(root):
    (root / "train" / "A" / "003.bmp").write_bytes(b"")
    return root


def break_manifest(root):
    (root / "manifest.jsonl").write_text('{"name": 3\n')
    return root


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (break_nothing_there, "is not a folder"),
        (break_no_sides, "holds no pairs: it needs train/A and train/B"),
        (break_no_images, "holds no images"),
        (break_explorations, "holds explorations; make images of them"),
        (
            break_missing_file,
            "holds images without a counterpart, 1 of them; the first is A/003 without B/003",
        ),
        (break_side_missing, "is missing; pairs need a folder A"),
        (break_shape_of_b, r"has shape \(32, 40\) but its counterpart A has \(32, 32\)"),
        (break_not_square, "training images are square"),
        (break_other_size, "has 64 px a side but the images before it 32"),
        (break_colour, "is coloured"),
        (break_depth, "pixels of type uint16"),
        (break_garbage, "is not a picture"),
        (break_name, "has the name of 003.png, too"),
        (break_manifest, "manifest.jsonl:1: is not valid JSON"),
    ],
)
def test_malformed_folders_are_one_clear_error(tmp_path, make_images, damage, message):
    with pytest.raises(InputFileError, match=message):
        load_pairs(damage(make_images(tmp_path)), "train", 32)


def rewrite(root, change, suffix=".png"):
    """Write all images of a folder again, changed or in another format."""
    for path in list((root / "train").rglob("*.png")):
        image = change(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        path.unlink()
        cv2.imwrite(str(path.with_suffix(suffix)), image)
    return root


def test_white_may_be_255(tmp_path, make_images):
    expected = load_pairs(make_images(tmp_path / "a"), "train", 32)
    white = rewrite(make_images(tmp_path / "b"), lambda image: np.where(image == FREE, 255, image))
    found = load_pairs(white, "train", 32)
    assert np.array_equal(found.cad, expected.cad)
    assert np.array_equal(found.slam, expected.slam)


@pytest.mark.parametrize("suffix", [".jpg", ".bmp", ".pgm"])
def test_folders_of_other_formats_keep_their_size_and_cells(tmp_path, make_images, suffix):
    expected = load_pairs(make_images(tmp_path / "a", side=64), "train", 64)
    root = rewrite(make_images(tmp_path / "b", side=64), lambda image: image, suffix)
    assert image_side(root, "train") == 64
    found = load_pairs(root, "train", 64)
    right = np.mean(found.slam == expected.slam)
    if suffix == ".jpg":  # its blocks smear walls of one pixel
        assert right > 0.93
        assert np.mean((found.cad > 127) == (expected.cad > 127)) > 0.99
    else:
        assert right == 1.0
        assert np.array_equal(found.cad, expected.cad)


def test_what_a_mac_leaves_beside_images_is_no_image(tmp_path, make_images):
    root = make_images(tmp_path)
    for side in "AB":
        (root / "train" / side / "._000.png").write_bytes(b"Mac OS X        resource fork")
    (root / "train" / "A" / ".DS_Store").write_bytes(b"x")
    assert image_side(root, "train") == 32
    assert len(load_pairs(root, "train", 32)) == 6


@pytest.mark.parametrize(
    ("side", "values", "message"),
    [
        ("A", {OCCUPIED: 0, FREE: 1}, "A/003.png: is no CAD map: its lightest value is 1,"),
        ("A", {OCCUPIED: 205}, "A/003.png: is no CAD map: it has areas of the value 205,"),
        ("B", {UNKNOWN: 1, FREE: 2}, "B/003.png: is no grey map: its lightest value is 2,"),
        ("B", {UNKNOWN: 64}, "B/003.png: is no grey map: it has areas of the value 64,"),
    ],
)
def test_images_of_other_values_are_named_with_the_value(
    tmp_path, make_images, side, values, message
):
    path = make_images(tmp_path) / "train" / side / "003.png"
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    changed = image.copy()
    for value, other in values.items():
        changed[image == value] = other
    cv2.imwrite(str(path), changed)
    with pytest.raises(InputFileError, match=message):
        load_pairs(tmp_path, "train", 32)


def test_a_probability_map_is_a_grey_map(tmp_path, make_images):
    rng = np.random.default_rng(0)
    root = make_images(tmp_path)
    path = root / "train" / "B" / "003.png"
    cells = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    grey = np.where(cells == FREE, rng.integers(225, 256, cells.shape), cells)
    grey = np.where(cells == OCCUPIED, rng.integers(0, 80, cells.shape), grey)
    cv2.imwrite(str(path), grey.astype(np.uint8))
    assert np.array_equal(load_pairs(root, "train", 32).slam[3], cells)


def test_a_grey_image_of_three_channels_is_taken(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((4, 4, 3), 205, np.uint8))
    assert read_grey(tmp_path / "a.png").tolist() == [[205] * 4] * 4


@pytest.mark.parametrize("encoding", ["grey", "rgb", "free_occupied"])
def test_slam_maps_survive_encoding(make_pair, encoding):
    _, slam = make_pair(3)
    encoded = encode(torch.from_numpy(slam[np.newaxis]), encoding)
    assert encoded.shape[1] == {"grey": 1, "free_occupied": 2, "rgb": 3}[encoding]
    assert encoded.abs().max() <= 1.0
    assert np.array_equal(decode_slam(encoded[0].numpy(), encoding), slam)


@pytest.mark.parametrize("encoding", ["grey", "rgb", "free_occupied"])
def test_cad_maps_survive_encoding(make_pair, encoding):
    cad, _ = make_pair(3)
    encoded = encode(torch.from_numpy(cad[np.newaxis]), encoding)
    assert np.array_equal(free_probability(encoded[0].numpy(), encoding) > 0.5, cad == FREE)


def test_a_wall_one_cell_thick_survives_shrinking_to_a_third():
    cells = np.full((48, 48), FREE, np.uint8)
    cells[:, 20] = OCCUPIED
    small = resample_slam(cells, (16, 16))
    assert (small == OCCUPIED).any(axis=1).all()
    assert set(np.unique(resample_slam(cells, (96, 96)))) == {OCCUPIED, FREE}


def test_shrinking_invents_no_unknown_and_loses_none():
    cells = np.full((32, 32), UNKNOWN, np.uint8)
    cells[:16] = FREE
    small = resample_slam(cells, (8, 8))
    assert (small[:4] == FREE).all()
    assert (small[4:] == UNKNOWN).all()


@pytest.fixture
def pairs(tmp_path, make_images, monkeypatch):
    monkeypatch.setattr("slamgym.gan.training.sampler.flipped", lambda image, symmetry: image)
    return load_pairs(make_images(tmp_path, count=7), "train", 32)


def test_every_pair_comes_once_a_pass(pairs):
    sampler = BatchSampler(pairs, find_preset("model32"), np.random.default_rng(0))
    drawn = np.concatenate(
        [sampler.draw(3).slam for _ in range(7)]
    )  # three passes over seven pairs
    counts = [sum(np.array_equal(image, slam) for image in drawn) for slam in pairs.slam]
    assert counts == [3] * 7


def test_unassociated_targets_are_other_places(pairs):
    sampler = BatchSampler(pairs, find_preset("model32"), np.random.default_rng(0))
    for _ in range(5):
        batch = sampler.draw(4)
        for cad, other in zip(batch.cad, batch.other_cad, strict=True):
            assert not np.array_equal(cad, other)
            assert any(np.array_equal(other, known) for known in pairs.cad)


def test_unassociated_targets_go_through_the_same_changes(pairs):
    config = dataclasses.replace(find_preset("modelprog"), augment=True)
    sampler = BatchSampler(pairs, config, np.random.default_rng(0))
    batches = [sampler.draw(7) for _ in range(30)]
    # A discriminator could recognise them by their greys if one kind were interpolated and the other not.
    greys = [np.mean((b > 0) & (b < FREE)) for b in (np.stack([x.cad for x in batches]),)]
    others = [np.mean((b > 0) & (b < FREE)) for b in (np.stack([x.other_cad for x in batches]),)]
    assert greys[0] > 0.0
    assert others[0] == pytest.approx(greys[0], rel=0.15)  # 210 samples each


def test_the_stream_goes_on_where_it_was_stored(pairs):
    config = dataclasses.replace(find_preset("model32"), augment=True)
    sampler = BatchSampler(pairs, config, np.random.default_rng(0))
    sampler.draw(5)
    state = json.loads(json.dumps(sampler.state()))
    expected = [sampler.draw(4) for _ in range(3)]
    again = BatchSampler(pairs, config, np.random.default_rng(99))
    again.restore(state)
    for batch in expected:
        resumed = again.draw(4)
        for part in ("cad", "slam", "other_cad", "other_slam"):
            assert np.array_equal(getattr(batch, part), getattr(resumed, part))


@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 4, 8]))
def test_an_enlarged_map_has_the_means_that_it_was_enlarged_from(seed, factor):
    floor = np.random.default_rng(seed).random((16, 16)) < 0.7
    small = cv2.GaussianBlur(floor.astype(np.float32), (3, 3), 0.0)
    large = enlarge_means(small, (16 * factor, 16 * factor))
    assert large.min() >= 0.0
    assert large.max() <= 1.0
    means = cv2.resize(large, (16, 16), interpolation=cv2.INTER_AREA)
    # Ten rounds leave a little at pixels that would have to pass 0 or 1.
    assert np.abs(means - small).mean() < 0.01


def test_a_thin_wall_survives_enlarging_where_interpolation_blurs_it_away():
    cad = np.ones((64, 64), np.float32)
    cad[:, 33:35] = 0.0  # half of a column of cells
    small = cv2.resize(cad, (16, 16), interpolation=cv2.INTER_AREA)
    assert (cv2.resize(small, (64, 64), interpolation=cv2.INTER_LINEAR) >= 0.5).mean() > 0.99
    wall = enlarge_means(small, (64, 64))[32] < 0.5
    assert wall.any()
    assert np.flatnonzero(wall).min() >= 29
    assert np.flatnonzero(wall).max() <= 34


def test_windows_show_the_middle_of_what_is_known(make_pair):
    slam = np.full((1, 100, 100), UNKNOWN, np.uint8)
    slam[0, 60:90, 5:25] = FREE
    pairs = PairSet(slam.copy(), slam, ("a",), ("a",), np.array([0.05]))
    cut = pairs.windows(40)
    assert cut.slam.shape == cut.cad.shape == (1, 40, 40)
    assert (cut.slam == FREE).sum() == 30 * 20
    assert cut.scale(0) == 0.05
    assert pairs.windows(200) is pairs


@pytest.mark.parametrize(("edge", "expected"), [(0.0, 0.0), (3.0, 3.0), (None, 0.0)])
def test_lines_along_faces_are_read_from_the_images_settings(edge, expected, make_images, tmp_path):
    root = make_images(tmp_path)
    if edge is not None:
        (root / "config.json").write_text(json.dumps({"images": {"edge_px": edge}}))
    assert face_lines(root) == expected
    assert image_side(root, "train") == 32


def test_images_of_several_editions_are_not_mixed(make_images, tmp_path):
    roots = [make_images(tmp_path / name, manifest=True) for name in ("old", "new")]
    for root, dataset in zip(roots, ({"edition": 1}, {"edition": 2}), strict=True):
        (root / "config.json").write_text(json.dumps({"dataset": {"config_sha256": "0"} | dataset}))
    assert describe_data(roots[1:]).startswith("new (edition 2, manifest.jsonl ")
    with pytest.raises(
        ConfigError, match=r"old \(edition 1, .*, new \(edition 2, .*make those of the older"
    ):
        describe_data(roots)


def test_without_flips_and_augmentation_pairs_are_learned_as_they_are(tmp_path, make_images):
    pairs = load_pairs(make_images(tmp_path), "train", 32)
    config = dataclasses.replace(find_preset("model32"), flips=False)
    batch = BatchSampler(pairs, config, np.random.default_rng(0)).draw(6)
    known = {image.tobytes() for image in pairs.slam}
    assert {image.tobytes() for image in batch.slam} == known

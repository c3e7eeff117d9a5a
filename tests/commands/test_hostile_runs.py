"""Commands that train, translate, replay and film write into their output folder alone, whatever lies in it already."""

import importlib.util
import json
import shutil

import cv2
import numpy as np
import pytest
from commands.hostile import RUNS, content_of, run
from shapely import box

from slamgym.cad import FloorPlan
from slamgym.cad.houseexpo import write_houseexpo
from slamgym.core.types import FREE, OCCUPIED, GridFrame, OccupancyGrid
from slamgym.dataset import Layout
from slamgym.interop import write_ros_map

TORCH = importlib.util.find_spec("torch") is not None
NEEDS_TORCH = {name for name in RUNS if name.startswith("gan ")} | {
    "agents train frontiers",
    "agents train wheels",
    "agents shape",
}


def picture(seed):
    cells = np.full((32, 32), OCCUPIED, np.uint8)
    cells[4 + seed : 28, 4:28] = FREE
    return cells


@pytest.fixture
def given(place, request):
    """What the commands read: plans and images with names that lead elsewhere, a log, weights."""
    dataset = place / "dataset"
    images = place / "dataset" / "images"
    write_houseexpo(dataset / "plans" / "...json", FloorPlan("..", box(0, 0, 4.0, 1.6)))
    for index in range(4):
        for side in "AB":
            folder = images / "train" / side
            folder.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / f"{index}.png"), picture(index))
    line = {"plan_id": "../x", "group": "/abs", "metres_per_px": 0.1, "split": "train"}
    names = [f"{place}/outside/x", "../../x", "0", "1", "2", "3"]
    (images / "manifest.jsonl").write_text(
        "".join(json.dumps({**line, "name": n}) + "\n" for n in names)
    )
    maps = dataset / "maps"
    for index in range(8 if request.node.callspec.params["command"] == "dataset realism" else 0):
        cells = np.full((120, 150), OCCUPIED, np.uint8)
        cells[4:100, 4 : 100 + 5 * index] = FREE
        maps.mkdir(exist_ok=True)
        write_ros_map(
            maps / (".x" if index == 0 else str(index)),
            OccupancyGrid(cells, GridFrame(0.05, 0.0, 0.0, 120, 150)),
        )
    folders = {
        "maps": maps,
        "robots": shutil.copytree(maps, dataset / "robots") if maps.exists() else maps,
        "episode": next(Layout(dataset).episodes.iterdir()),
        "images": images,
        "plans": dataset / "plans",
    }
    if request.node.callspec.params["command"] == "gan translate":
        folders["weights"] = small_weights(dataset / "tiny.safetensors")
    return folders


def small_weights(path):
    from slamgym.gan.config import GeneratorConfig, TranslatorConfig
    from slamgym.gan.networks.factory import build_generator
    from slamgym.gan.weights import ModelCard, save_translator

    config = TranslatorConfig(
        input_size=16, output_size=16, input_encoding="grey", output_encoding="layers",
        generator=GeneratorConfig("residual", width=8, depth=2),
    )  # fmt: skip
    save_translator(path, build_generator(config, seed=1), config, ModelCard(preset="tiny"))
    return path


@pytest.mark.parametrize("command", sorted(RUNS))
def test_nothing_is_written_through_links_in_the_output_folder(
    command, place, given, capsys, monkeypatch
):
    if command in NEEDS_TORCH and not TORCH:
        pytest.skip("needs torch")
    # The trees take seconds and write nothing.
    monkeypatch.setattr("slamgym.commands.dataset.realism.is_installed", lambda _: False)
    out = place / "out" / "run"
    code, error = run(RUNS[command], place, capsys, **given)
    assert code == 0, error
    written = sorted(path for path in out.rglob("*") if path.is_file())
    assert written
    folders = sorted(path for path in out.rglob("*") if path.is_dir())
    first = content_of(out)
    for chosen in (written, folders):
        for path in chosen:
            if not path.is_symlink() and path.exists():
                shutil.rmtree(path) if path.is_dir() else path.unlink()
                path.symlink_to(place / "outside" / ("" if path.suffix == "" else "log"))
        run(RUNS[command], place, capsys, **given)
        shutil.rmtree(out)
        restore(out, first)


def restore(folder, content):
    for name, inside in content.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(exist_ok=True) if inside is None else path.write_bytes(inside)


@pytest.mark.skipif(not TORCH, reason="needs torch")
@pytest.mark.parametrize("command", ["gan translate"])
def test_names_of_maps_to_translate_are_no_paths(command, place, given, capsys):
    folder = given["images"] / "train" / "B"
    source = write_ros_map(
        folder / "a", OccupancyGrid(picture(0), GridFrame(0.05, 0.0, 0.0, 32, 32))
    )
    for name in ("..yaml", "...yaml", "..png"):
        shutil.copyfile(source if name.endswith("yaml") else folder / "0.png", folder / name)
    assert run(RUNS[command], place, capsys, **given)[0] == 0
    assert {path.name for path in (place / "out").iterdir()} == {"run"}
    assert not [
        path.name for path in (place / "out" / "run").iterdir() if path.name.startswith(".")
    ]

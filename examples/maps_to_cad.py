"""Maps: explore, make pairs, train a translator from SLAM map to CAD map, and judge it.

Needs the extra `gan`. Run: ``python examples/maps_to_cad.py [PAIRS] [MINUTES]``
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from slamgym.agents import make_explorer
from slamgym.cad import open_plans
from slamgym.dataset import (
    DatasetConfig,
    ImageConfig,
    build_dataset,
    load_images,
    make_split,
    read_images,
    render_images,
    select_pairs,
)
from slamgym.envs import EpisodeConfig
from slamgym.gan.device import choose_compute
from slamgym.gan.presets import find_preset
from slamgym.gan.training.train import train_translator
from slamgym.gan.translation.translate import load_translator
from slamgym.metrics.cleaning import clean_map


def make_images(out: Path, pairs: int) -> Path:
    """Explore bundled plans and render uniform images; plans that look alike stay on one side."""
    config = DatasetConfig(seed=1, episode=EpisodeConfig(explorer="nearest", minutes=2.0))
    build_dataset(out / "pairs", open_plans("bundled"), config, make_explorer, pairs=pairs)
    split = make_split(out / "pairs", test=0.3, seed=3)
    selection = select_pairs(out / "pairs", 0.5)  # at least half of the floor seen
    # The default translator is made for cells of 5 cm.
    images = ImageConfig(size=640, scaling="fixed", metres_per_px=0.05)
    render_images(out / "pairs", out / "images", images, split, selection=selection)
    return out / "images"


def error(free: np.ndarray, cad: np.ndarray) -> float:
    """Mean squared error of the floor against the CAD map, not aligned."""
    return float(np.mean(((free > 0.5) != (cad > 127)).astype(float)))


def main(pairs: int, minutes: float) -> None:
    """The whole way, in a folder ``maps_to_cad`` here."""
    out = Path("maps_to_cad")
    images = make_images(out, pairs)
    config = dataclasses.replace(find_preset("slam2cad"), minutes=minutes)
    report = train_translator(images, out / "run", config, choose_compute("cpu"))
    print(f"{report.steps} steps on {report.images} images")
    methods = {
        "the raw SLAM map": lambda slam, _: slam == 254,
        "cleaning without learning": clean_map,
        "your translator": load_translator(out / "run").translate,
        "the pretrained one": load_translator("slam2cad").translate,
    }
    tests = [
        (*load_images(images, record), record.metres_per_px)
        for record in read_images(images, "test")
    ]
    for name, translate in methods.items():
        errors = [
            error(np.asarray(translate(slam, scale), float), cad) for cad, slam, scale in tests
        ]
        print(f"{name}: mean squared error {np.mean(errors):.3f} on {len(tests)} maps")


if __name__ == "__main__":
    main(
        int(sys.argv[1]) if len(sys.argv) > 1 else 24,
        float(sys.argv[2]) if len(sys.argv) > 2 else 10.0,
    )

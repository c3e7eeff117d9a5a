"""A small dataset that is explored once and copied by the tests that change it."""

import shutil

import pytest
from shapely import Polygon, box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, build_dataset
from slamgym.dataset.curate.split import make_split
from slamgym.dataset.generate.recipe import parse_recipe
from slamgym.dataset.images.render import render_images, select_pairs
from slamgym.dataset.images.square_images import ImageConfig
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.slam import SlamConfig


class SmallPlans:
    """Flats that are explored in seconds; two of them are mirror images."""

    def __init__(self):
        rooms = box(0, 0, 3.0, 2.4).difference(box(1.4, 0.0, 1.6, 1.4))
        mirrored = box(0, 0, 3.0, 2.4).difference(box(1.4, 1.0, 1.6, 2.4))
        corner = Polygon([(0, 0), (3.2, 0), (3.2, 1.5), (1.6, 1.5), (1.6, 2.8), (0, 2.8)])
        self.plans = {
            "rooms": FloorPlan("rooms", rooms),
            "corner": FloorPlan("corner", corner),
            "mirrored": FloorPlan("mirrored", mirrored),
            "hall": FloorPlan("hall", box(0, 0, 4.0, 1.6)),
        }
        self.ids = list(self.plans)

    def __len__(self):
        return len(self.ids)

    def load(self, plan_id):
        return self.plans[plan_id]


SMALL = DatasetConfig(
    seed=5,
    episode=EpisodeConfig(minutes=0.2, env=ExploreConfig(slam=SlamConfig(particles=5))),
    trajectories=2,
    recipe=parse_recipe({"odometry": ["low", "high"], "clutter.people": [0, 1]}, "test"),
)


@pytest.fixture(scope="session")
def explore():
    """A function of a folder and a number: make the small dataset there, or continue it, until it has so many pairs."""

    def make(root, pairs):
        return build_dataset(
            root,
            SmallPlans(),
            SMALL,
            make_explorer,
            pairs=pairs,
            execution=Execution(engine="in_process"),
        )

    return make


@pytest.fixture(scope="session")
def small_dataset(tmp_path_factory, explore):
    """Eight pairs of four plans; not to be changed."""
    root = tmp_path_factory.mktemp("small") / "dataset"
    explore(root, 8)
    return root


@pytest.fixture
def dataset_copy(small_dataset, tmp_path):
    """The same dataset, to be changed."""
    return shutil.copytree(small_dataset, tmp_path / "dataset")


@pytest.fixture(scope="session")
def longer_small_dataset(small_dataset, tmp_path_factory, explore):
    """The same dataset with two pairs more."""
    root = shutil.copytree(small_dataset, tmp_path_factory.mktemp("longer") / "dataset")
    explore(root, 10)
    return root


@pytest.fixture(scope="session")
def rendered(small_dataset, tmp_path_factory):
    """Images of the small dataset, which no test changes."""
    folder = tmp_path_factory.mktemp("rendered")
    dataset = shutil.copytree(small_dataset, folder / "dataset")
    split = make_split(dataset, test=0.4, seed=1)
    selection = select_pairs(dataset, 0.0)
    render_images(dataset, folder / "images", ImageConfig(size=64), split, selection=selection)
    return folder / "images"


@pytest.fixture
def images(rendered, tmp_path):
    """A copy of them."""
    return shutil.copytree(rendered, tmp_path / "images")

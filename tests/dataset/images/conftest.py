"""Rendered images of the dataset of the tests."""

import pytest

from slamgym.dataset.curate.split import make_split
from slamgym.dataset.images.render import render_images, select_pairs
from slamgym.dataset.images.square_images import ImageConfig


@pytest.fixture
def images(dataset_copy, tmp_path):
    split = make_split(dataset_copy, test=0.4, seed=1)
    selection = select_pairs(dataset_copy, 0.0)
    render_images(
        dataset_copy, tmp_path / "images", ImageConfig(size=64), split, selection=selection
    )
    return tmp_path / "images"

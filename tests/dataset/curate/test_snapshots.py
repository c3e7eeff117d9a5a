import dataclasses

import numpy as np
import pytest
from shapely import box

from slamgym.agents.registry import make_explorer
from slamgym.cad import FloorPlan
from slamgym.core.errors import InputFileError
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, Layout, build_dataset, load_pair, read_manifest
from slamgym.dataset.curate.criteria import Criteria, StuckFilter
from slamgym.dataset.curate.snapshots import label_maps, take_snapshots
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.envs.episode import run_episode
from slamgym.slam import SlamConfig

PLAN = FloorPlan("rooms", box(0, 0, 9.0, 5.0).difference(box(4.4, 0.0, 4.6, 3.8)))
EPISODE = EpisodeConfig(minutes=0.8, env=ExploreConfig(slam=SlamConfig(particles=4)))
MINUTES = (0.1, 0.4)


class OnePlan:
    ids = ("rooms",)

    def __len__(self):
        return 1

    def load(self, plan_id):
        return PLAN


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("snapshots") / "dataset"
    build_dataset(
        root,
        OnePlan(),
        DatasetConfig(seed=1, episode=EPISODE),
        make_explorer,
        pairs=2,
        execution=Execution(engine="in_process"),
    )
    return root


def test_coverage_and_map_grow_up_to_the_pair_itself(dataset):
    for record in read_manifest(dataset):
        shots = list(take_snapshots(dataset, record, MINUTES))
        assert [shot.time for shot in shots] == pytest.approx([6.0, 24.0, record.robot_seconds])
        assert [shot.is_last for shot in shots] == [False, False, True]
        coverage = [shot.coverage for shot in shots]
        assert coverage == sorted(coverage)
        assert coverage[-1] == record.coverage
        known = [np.count_nonzero(shot.cells != 205) for shot in shots]
        assert known == sorted(known)
        assert (shots[-1].cells == load_pair(dataset, record.name)[1]).all()
        driven = [shot.path_length for shot in shots]
        assert driven == sorted(driven)
        assert driven[-1] == pytest.approx(record.path_length, abs=0.05)
        assert all(shot.cells.shape == record.shape for shot in shots)


def test_the_coverage_of_a_moment_is_that_of_an_exploration_cut_off_there(dataset):
    for record in read_manifest(dataset):
        shots = list(take_snapshots(dataset, record, MINUTES))[:-1]
        for shot in shots:
            cut = dataclasses.replace(EPISODE, minutes=shot.time / 60.0)
            exact = run_episode(PLAN, record.seed, cut, make_explorer)
            # Scans with noise stand in for exact ones, and their counts for the cells of a floor of 10 cm.
            assert shot.coverage == pytest.approx(exact.coverage, abs=0.03)


def test_drawing_all_scans_gives_the_map_of_the_exploration(dataset):
    """A moment just before the end shows the pair's map but for the last scan and the rounding of text files."""
    record = next(iter(read_manifest(dataset)))
    almost = (record.robot_seconds - 0.05) / 60.0
    shot = next(iter(take_snapshots(dataset, record, (almost,))))
    assert not shot.is_last
    agreement = (shot.cells == load_pair(dataset, record.name)[1]).mean()
    assert agreement > 0.995
    assert shot.map_error == pytest.approx(record.map_error, abs=0.01)
    assert shot.ate == pytest.approx(record.ate, abs=0.02)


def test_labels_follow_the_criteria(dataset):
    pairs = [(dataset, record) for record in read_manifest(dataset)]
    maps = label_maps(
        pairs, Criteria(min_coverage=0.5, max_map_error=5.0, max_ate=5.0), StuckFilter(), MINUTES
    )
    assert len(maps) == 6
    assert (maps.complete == (maps.coverage >= 0.5)).all()
    assert maps.is_last.sum() == 2
    assert maps.features.shape == (6, 15)
    assert set(maps.plan_ids) == {"rooms"}
    strict = label_maps(pairs, Criteria(max_map_error=1e-6), StuckFilter(), MINUTES)
    assert not strict.complete.any()
    half = maps.where(maps.is_last)
    assert len(half) == len(half.plan_ids) == 2


def test_a_missing_log_is_named(dataset, tmp_path):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    record = next(iter(read_manifest(copy)))
    for path in Layout(copy).episode(record.name).glob("scans.log*"):
        path.unlink()
    with pytest.raises(InputFileError, match=r"scans\.log"):
        list(take_snapshots(copy, record))

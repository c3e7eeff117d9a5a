"""A small dataset: images, logs, maps and manifest."""

import gzip
import json

import pytest

from slamgym.agents.registry import make_explorer
from slamgym.cad import open_plans
from slamgym.cad.plan_index import some_plans
from slamgym.core.parallel.engine import Execution
from slamgym.dataset import DatasetConfig, Layout, build_dataset, load_pair, read_manifest
from slamgym.dataset.format import read_dataset_config
from slamgym.envs import EpisodeConfig, ExploreConfig
from slamgym.interop import read_carmen
from slamgym.slam import SlamConfig

PLANS = ("home_000001", "office_000002")
CONFIG = DatasetConfig(
    seed=11, episode=EpisodeConfig(minutes=0.5, env=ExploreConfig(slam=SlamConfig(particles=6)))
)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("golden") / "dataset"
    build_dataset(
        root,
        some_plans(open_plans("bundled"), PLANS),
        CONFIG,
        make_explorer,
        pairs=3,
        execution=Execution(engine="in_process"),
    )
    return root


def test_images(dataset, golden):
    for record in read_manifest(dataset):
        for side, cells in zip("AB", load_pair(dataset, record.name), strict=True):
            golden.check(f"dataset/image {side}/{record.name}", golden.of_cells(cells))


def test_manifest(dataset, golden):
    for line in Layout(dataset).manifest.read_text().splitlines():
        record = json.loads(line)
        # Hashes of settings and of files change with every name in them and with the compressor's version.
        for name in ("config_hash", "version", "sha256"):
            del record[name]
        golden.check(f"dataset/manifest/{record['name']}", record)


def test_settings(dataset, golden):
    settings = read_dataset_config(dataset)
    del settings["version"]
    golden.check("dataset/settings", settings)


def test_episode_files(dataset, golden):
    for record in read_manifest(dataset):
        digests = {}
        for path in sorted(Layout(dataset).episode(record.name).iterdir()):
            if path.name not in ("SHA256SUMS", "episode.json"):
                content = (
                    gzip.decompress(path.read_bytes())
                    if path.suffix == ".gz"
                    else path.read_bytes()
                )
                digests[path.name] = golden.digest(content)
        golden.check(f"dataset/files/{record.name}", digests)


def test_logs(dataset, golden):
    for record in read_manifest(dataset):
        log = read_carmen(Layout(dataset).episode(record.name) / "scans.log.gz")
        values = {
            "scans": len(log),
            "odometry": golden.of_path([entry.odometry for entry in log]),
            "ranges": golden.rounded_digest([entry.scan.ranges for entry in log]),
            "stamps": golden.rounded_digest([entry.stamp for entry in log]),
            "geometry": golden.rounded_digest([*log.geometry[:5], *log.geometry.mount]),
        }
        golden.check(f"dataset/log/{record.name}", values)

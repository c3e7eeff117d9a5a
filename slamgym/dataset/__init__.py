"""Map pairs: explorations of floor plans, and the folder in which they are kept."""

from slamgym.dataset.curate.split import make_split, read_split
from slamgym.dataset.format import Layout, load_pair, read_dataset_config, read_manifest
from slamgym.dataset.generate.build import BuildReport, DatasetConfig, build_dataset
from slamgym.dataset.images.format import ImageRecord, load_images, read_images
from slamgym.dataset.images.render import render_images, select_pairs
from slamgym.dataset.images.square_images import ImageConfig
from slamgym.dataset.pair import MapPair, PairConfig, make_pair
from slamgym.dataset.record import PairRecord
from slamgym.dataset.statistics import describe_pairs, write_contact_sheet
from slamgym.envs.episode import Episode, EpisodeConfig, run_episode

__all__ = [
    "BuildReport",
    "DatasetConfig",
    "Episode",
    "EpisodeConfig",
    "ImageConfig",
    "ImageRecord",
    "Layout",
    "MapPair",
    "PairConfig",
    "PairRecord",
    "build_dataset",
    "describe_pairs",
    "load_images",
    "load_pair",
    "make_pair",
    "make_split",
    "read_dataset_config",
    "read_images",
    "read_manifest",
    "read_split",
    "render_images",
    "run_episode",
    "select_pairs",
    "write_contact_sheet",
]

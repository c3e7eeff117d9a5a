from .curate.split import make_split, read_split
from .format import Layout, PairRecord, load_pair, read_config, read_manifest
from .generate.build import BuildReport, build_dataset
from .generate.exploration import run_episode
from .generate.record import Episode
from .generate.settings import DatasetConfig, EpisodeConfig
from .images.format import ImageRecord, load_images, read_images
from .images.render import render_images
from .images.selection import select_pairs
from .images.square_images import ImageConfig
from .pair import MapPair, PairConfig, make_pair
from .summary import describe_pairs, write_contact_sheet

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
    "read_config",
    "read_images",
    "read_manifest",
    "read_split",
    "render_images",
    "run_episode",
    "select_pairs",
    "write_contact_sheet",
]

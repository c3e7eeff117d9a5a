from .curate.split import make_split, read_split
from .format import Layout, load_pair, read_dataset_config, read_manifest
from .generate.build import BuildReport, DatasetConfig, build_dataset
from .images.format import ImageRecord, load_images, read_images
from .images.render import render_images, select_pairs
from .images.square_images import ImageConfig
from .record import MapPair, PairConfig, PairRecord, make_pair
from .statistics import describe_pairs

__all__ = [
    "BuildReport",
    "DatasetConfig",
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
    "select_pairs",
]

"""Map pairs: explorations of floor plans, and the folder in which they are kept."""

from slamgym.dataset.build import BuildReport, DatasetConfig, build_dataset
from slamgym.dataset.episode import Episode, EpisodeConfig, run_episode
from slamgym.dataset.format import Layout, PairRecord, load_pair, read_config, read_manifest
from slamgym.dataset.pair import MapPair, PairConfig, make_pair
from slamgym.dataset.summary import describe_pairs, write_contact_sheet

__all__ = [
    "BuildReport",
    "DatasetConfig",
    "Episode",
    "EpisodeConfig",
    "Layout",
    "MapPair",
    "PairConfig",
    "PairRecord",
    "build_dataset",
    "describe_pairs",
    "load_pair",
    "make_pair",
    "read_config",
    "read_manifest",
    "run_episode",
    "write_contact_sheet",
]

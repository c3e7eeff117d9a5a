"""The pairs of a training: read, registered, and some plans of them held out to watch it."""

import zlib
from collections.abc import Sequence
from pathlib import Path

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.progress import counted, say
from slamgym.gan.config import TranslatorTrainingConfig
from slamgym.gan.data import PairSet, load_training_pairs
from slamgym.gan.pair_files import image_side
from slamgym.gan.registration import registered

VALIDATION_SHARE = 0.04
"""Share of the training plans that is held out to watch the training."""
LARGEST_SHARE = 0.2
"""Largest share that is held out where the held-out pairs decide when the training stops."""
DECIDING_PAIRS = 16
"""So many pairs shall decide when it stops, if the largest share has them."""
MAX_VALIDATION_PAIRS = 64
"""Most pairs of the held-out plans that are looked at."""
MIN_PAIRS = 2
"""Fewest pairs that a training is begun with."""
ONE_SCALE = 1.3
"""Pairs whose largest scale is more than so many times the smallest don't have one scale; training zooms by 15 %."""


def training_pairs(
    images: Sequence[Path], run: Path, config: TranslatorTrainingConfig
) -> tuple[PairSet, PairSet]:
    """(pairs to train on, pairs of held-out plans).

    Raises:
        ConfigError: If there are too few pairs, or no folder of them.
        InputFileError: If the images can't be used.
    """
    if not images:
        raise ConfigError(
            "name at least one folder of pairs, as `slamgym dataset render` writes them"
        )
    named = ", ".join(folder.name for folder in images)
    say(f"reading the pairs of {named}")
    side = config.translator.input_size
    read_side = side
    if config.augment:  # windows are cut at the images' own scale
        read_side = max(side, _common_side(images))
    pairs = load_training_pairs(images, read_side)
    _warn_of_scales(pairs, config)
    if config.register:
        pairs = registered(pairs, run / "registration.safetensors", checksum(pairs))
    share = VALIDATION_SHARE
    if config.patience > 0:
        wanted = DECIDING_PAIRS / len(pairs)
        share = max(share, min(wanted, LARGEST_SHARE))
    rest, held_out = pairs.split(share)
    if len(rest) < MIN_PAIRS:
        raise ConfigError(
            f"{named}: training needs at least {MIN_PAIRS} pairs beside the held-out ones, not {len(rest)}"
        )
    if config.patience > 0 and len(held_out) == 0:
        say(
            f"{counted(len(rest), 'pair')} are too few to hold some out, so nothing can stop this training before its "
            "end; --epochs shortens it"
        )
    watched = held_out.subset(range(min(len(held_out), MAX_VALIDATION_PAIRS)))
    return rest, watched.windows(side)


def _warn_of_scales(pairs: PairSet, config: TranslatorTrainingConfig) -> None:
    """Say that pairs have many scales where the network learns how many pixels thick a wall is."""
    scales = pairs.scale_percentiles()
    if scales is None or config.translator.generator.kind != "residual":
        return
    low, _, high = scales
    if high > ONE_SCALE * low:
        say(
            f"the pairs have {low:.3f} to {high:.3f} m a pixel, but {config.preset} learns at one scale: render "
            "them by `slamgym dataset render --scaling fixed --metres-per-px 0.05 --size 640`"
        )


def _common_side(images: Sequence[Path]) -> int:
    """Side of all folders' images [px].

    Raises:
        InputFileError: If they differ: windows are cut at the images' own scale.
    """
    first = image_side(images[0], "train")
    for folder in images:
        side = image_side(folder, "train")
        if side != first:
            raise InputFileError(
                folder,
                f"has images of {side} px but {images[0]} of {first}; render all with one --size",
            )
    return first


def checksum(pairs: PairSet) -> str:
    """A checksum over all pixels."""
    of_cad = zlib.crc32(pairs.cad.data)
    of_both = zlib.crc32(pairs.slam.data, of_cad)
    return f"{of_both:08x}"

"""Random choices that follow from seeds and names alone: the same on every machine, in any order of the work."""

import hashlib
from collections.abc import Sequence

import numpy as np


def exploration_seed(seed: int, plan_id: str, repetition: int) -> int:
    """The seed of one exploration of a plan, 0 to 2^63 - 1."""
    return _first_64_bits(f"{seed}/{plan_id}/{repetition}") >> 1


def uniform_share(name: str) -> float:
    """A number in [0, 1) that follows from a name."""
    return _first_64_bits(name) / 2.0**64


def shuffled(names: Sequence[str], seed: int | tuple[int, int]) -> list[str]:
    """The names in an order that follows from the seed."""
    return [names[place] for place in np.random.default_rng(seed).permutation(len(names))]


def _first_64_bits(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode(errors="surrogatepass")).digest()[:8], "big")

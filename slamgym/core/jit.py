"""One place that decides how the numeric kernels are compiled.

Kernels are compiled on first use and cached beside the source (or in the user's cache folder where the
package is read-only), so only the very first use after an installation waits for the compiler.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_F = TypeVar("_F", bound=Callable[..., Any])


def kernel(function: _F) -> _F:
    """Compile a numeric kernel: cached on disk, the GIL released, no fast-math.

    Fast-math stays off so that the same seed gives the same bytes on every call path and so that ``inf``
    (a beam without return) keeps its meaning.
    """
    compiled: _F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return compiled

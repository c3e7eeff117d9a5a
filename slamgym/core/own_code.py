"""Functions of the user's own, named on the command line as ``module:function``, and never by a file."""

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from slamgym.core.errors import ConfigError


def is_own_explorer(name: str) -> bool:
    """Whether an explorer's name is ``module:function``, and neither weights (``rl:FILE``) nor ``rl@98%:95%``."""
    module, colon, _ = name.partition("@")[0].partition(":")
    return bool(colon) and module not in ("rl", "wheels")


def own_function(spec: str, what: str) -> Callable[..., Any]:
    """Import a function; its module is looked for in the current folder, too.

    An installed command doesn't look there by itself. The module's code is run, as the user who names it wants.

    Args:
        spec: ``module:function``.
        what: What names it, for errors.

    Raises:
        ConfigError: If it can't be imported, or is no function.
    """
    module, _, name = spec.partition(":")
    folder = str(Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        function = getattr(importlib.import_module(module), name) if module and name else None
    except (ImportError, AttributeError, SyntaxError, TypeError) as error:
        raise ConfigError(f"{what} {spec!r} can't be imported ({error}); give module:function") from None
    if not callable(function):
        raise ConfigError(f"{what} {spec!r} must be module:function")
    return function

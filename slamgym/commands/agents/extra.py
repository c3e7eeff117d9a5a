"""Whether the extra ``agents`` is installed, which learning needs and exploring doesn't."""

import importlib.util

from slamgym.core.errors import SlamgymError


def require_torch(what: str) -> None:
    """Refuse with one sentence where the packages for learning are missing.

    Args:
        what: Names what needs them.

    Raises:
        SlamgymError: If one of them isn't installed.
    """
    for package in ("torch", "stable_baselines3", "sb3_contrib"):
        if importlib.util.find_spec(package) is None:
            raise SlamgymError(f'{what} needs {package}; install it with: pip install "slamgym[agents]"')

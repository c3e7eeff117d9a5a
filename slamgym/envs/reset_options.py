"""What ``reset(options=...)`` may hold."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from slamgym.cad import FloorPlan
from slamgym.core.config import suggest
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D


class ResetOptions(NamedTuple):
    """Wishes for an episode; what is None is drawn."""

    plan: str | FloorPlan | None = None
    start: Pose2D | None = None

    @classmethod
    def read(cls, options: Mapping[str, Any] | None) -> "ResetOptions":
        """Check the options of a reset.

        Raises:
            ConfigError: If one is unknown or of a wrong kind.
        """
        options = options or {}
        for name in options:
            if name not in cls._fields:
                raise ConfigError(f"unknown reset option {name!r}; {suggest(name, cls._fields)}")
        plan, start = options.get("plan"), options.get("start")
        if plan is not None and not isinstance(plan, str | FloorPlan):
            raise ConfigError(f"the reset option 'plan' must be an id or a FloorPlan, not {plan!r}")
        if start is None:
            return cls(plan)
        try:
            x, y, theta = (float(value) for value in start)
        except (TypeError, ValueError):
            raise ConfigError(f"the reset option 'start' must be (x, y, theta), not {start!r}") from None
        return cls(plan, Pose2D(x, y, theta))

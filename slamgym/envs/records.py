"""One step of an exploration, as rewards see it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from slamgym.core.config import suggest
from slamgym.core.types import Float32Array, FloatArray, OccupancyGrid

Reader = Callable[[str, int | None], Any]
"""Measures a figure by its name: a robot's, or where that is None those of all robots, one row for each."""


class StepRecord:
    """One transition, as a reward function sees it: of one robot, or of many with a row for each.

    A figure is measured when it is first read, which must be before the next step; what no reward reads costs nothing.
    ``previous_`` figures are those before the step; of the map's error, area and entropy that is where a reward reads
    them at each step, else those last read, at first those of the first map.

    A record made by hand, ``StepRecord(coverage=0.5, previous_coverage=0.4)``, has what it is given: to read anything
    else is an error.

    Args:
        reader: Measures what is read.
        **figures: What is known already.
    """

    duration: float
    """Duration of the step [s]."""
    time: float
    """Robot time after the step [s]."""
    action: FloatArray
    """Speed and turning rate that were asked for, within the robot's limits, shape (2,) [m/s, rad/s]."""
    previous_action: FloatArray
    distance: float
    """True path length of the robot during the step [m]."""
    turning: float
    """True turn of the robot during the step, counter-clockwise [rad]."""
    contact: bool
    """True if an obstacle stopped or deflected the robot."""
    contacts: int
    """Contacts begun since the start."""
    clearance: float
    """True room between the robot's body and the nearest obstacle [m]."""
    revisits: int
    """How often the robot had come to this place before, if it has come to it in this step, else 0; places are squares
    of :data:`slamgym.envs.batch.arrays.PLACE`."""
    scan: Float32Array
    """The newest scan as the robot sees it, shape (num_beams,) [m]; infinite without return, -infinite too near."""
    pose: FloatArray
    """Believed pose in the map frame, shape (3,) [m, m, rad]."""
    covariance: FloatArray
    """Of the believed pose as the mapper states it, shape (3, 3) [m, m, rad]; zeros where it knows none."""
    pose_error: float
    """Distance of the believed from the true position [m]."""
    map: OccupancyGrid
    """The newest map, cropped to what is known."""
    known_area: float
    """Area of the map's known cells [m2]."""
    previous_known_area: float
    entropy: float
    """Entropy of the map over the building's bounding box [bit]: one for each unknown cell, none for a known one."""
    previous_entropy: float
    map_error: float
    """Mean distance of the map's occupied cells from the nearest true obstacle [m]; reading it costs half a step."""
    previous_map_error: float
    frontier_distance: float
    """From the believed place to the nearest frontier of the map that the robot can reach, as the crow flies [m];
    infinite if there is none."""
    coverage: float
    """Share of the reachable floor that was truly seen, in [0, 1]."""
    previous_coverage: float
    floor_area: float
    """The reachable floor [m2]."""
    terminated: bool
    """True if the exploration is complete: the coverage goal is reached or no frontier is left."""

    def __init__(self, reader: Reader | None = None, **figures: Any) -> None:
        for name in figures:
            if name not in FIGURES:
                raise TypeError(f"a StepRecord has no {name!r}; {suggest(name, FIGURES)}")
        self._reader = reader
        self._figures = figures
        vars(self).update(figures)

    def __getattr__(self, name: str) -> Any:
        """Measure a figure that wasn't read before."""
        if name not in FIGURES:
            hint = "" if name.startswith("_") else f"; {suggest(name, FIGURES)}"
            raise AttributeError(f"a StepRecord has no {name!r}{hint}")
        if self._reader is None:
            raise AttributeError(f"this StepRecord was made without {name!r}")
        value = self._reader(name, None)
        vars(self)[name] = value
        return value

    def of_robot(self, index: int) -> "StepRecord":
        """One robot's record; for a record of many."""

        def read(name: str, _: int | None) -> Any:
            if self._reader is not None and name not in vars(self):
                return self._reader(name, index)
            row = np.asarray(getattr(self, name))[index]
            return row.item() if row.ndim == 0 else row

        return StepRecord(read)

    def but(self, **figures: Any) -> "StepRecord":
        """The same record with other values of some figures."""
        return StepRecord(self._reader, **{**self._figures, **figures})


FIGURES = tuple(StepRecord.__annotations__)
"""Names of what a record holds."""

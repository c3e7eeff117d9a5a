"""Observations of many robots: by kernels where kernels map, else each robot's map is looked at as by itself."""

from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, IntArray, Pose2D, Twist2D
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.threads import divide_work
from slamgym.envs.compact import CompactObserver
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import FarLook
from slamgym.envs.observations import MapView, Measurements, SensedStep, crop_points, make_view


class BatchObserver:
    """Makes the observations of a fleet in the preset of the settings.

    Args:
        config: The settings.
        fleet: The robots.
    """

    def __init__(self, config: ExploreConfig, fleet: Fleet) -> None:
        count, observation = len(fleet), config.observation
        self._config, self._fleet = config, fleet
        compact = CompactObserver.of(config) if observation.is_compact else None
        self._far: Any = FarLook(count) if observation.preset == "compact_far" else None
        self._measurements = Measurements(config)
        shape = compact.space.shape if compact else observation.shape
        self._seen: Any = np.zeros((count, *shape), np.float32 if compact else np.uint8)
        self._views: dict[int, MapView] = {}  # of robots that are not mapped together
        points = crop_points(observation, config.slam.resolution)
        fleet.shown = (compact.side, compact.limits) if compact else points, self._seen

    def begin(self, ids: IntArray) -> None:
        """Forget the maps of robots that begin an episode."""
        if not self._fleet.is_mapped_together:
            self._views |= {i: make_view(self._config) for i in ids.tolist()}
        elif self._far:
            self._look_far(ids)  # makes room for all, which threads couldn't

    def observe(self, ids: IntArray, is_published: BoolArray) -> Any:
        """The observations of all robots, those of ``ids`` made again.

        Args:
            ids: Those that have sensed.
            is_published: Whose map was published just now, shape (N,).
        """
        fleet = self._fleet
        maps, robots, scans = fleet.maps, fleet.robots, fleet.scans
        if not fleet.is_mapped_together:
            divide_work(lambda part: self._look(part, is_published), ids, fleet.threads)
        elif self._far:
            divide_work(self._look_far, ids[is_published[ids]], fleet.threads)
            self._far.write(ids, maps.believed, self._seen)
        if self._config.observation.preset != "dict":
            return self._seen.copy()
        times = fleet.times[:, np.newaxis]
        return self._measurements.observe(
            self._seen.copy(), scans.ranges, maps.believed, robots.velocity, times
        )

    def _look_far(self, ids: IntArray) -> None:
        for i in ids.tolist():
            self._far.refresh(i, *self._fleet.tiles(i)[:3])

    def _look(self, ids: IntArray, is_published: BoolArray) -> None:
        fleet, maps = self._fleet, self._fleet.maps
        for i in ids.tolist():
            moving = Pose2D(*maps.believed[i].tolist()), Twist2D(*fleet.robots.velocity[i].tolist())
            flags = bool(maps.is_new[i]), bool(is_published[i])
            self._seen[i] = self._views[i].look(
                SensedStep(fleet.mapper(i), fleet.scans.ranges[i], *moving, *flags)
            )

"""Observations of many robots: by kernels where kernels map, else each robot's map is looked at as by itself."""

from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, IntArray, Pose2D, Twist2D
from slamgym.envs.batch.fleet import Fleet, KernelTarget
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
        observation = config.observation
        count = len(fleet)
        self._config = config
        self._fleet = fleet
        self._far: Any = FarLook(count) if observation.preset == "compact_far" else None
        self._measurements = Measurements(config)
        self._views: dict[int, MapView] = {}  # of robots that are not mapped together
        self._seen: Any
        view: tuple[float, Any]
        if observation.is_compact:
            compact = CompactObserver.of(config)
            self._seen = np.zeros((count, *compact.space.shape), np.float32)
            view = compact.side, compact.limits
        else:
            self._seen = np.zeros((count, *observation.shape), np.uint8)
            view = crop_points(observation, config.slam.resolution)
        fleet.target = KernelTarget(view, self._seen)

    def begin(self, ids: IntArray) -> None:
        """Forget the maps of robots that begin an episode."""
        if not self._fleet.is_mapped_together:
            for i in ids.tolist():
                self._views[i] = make_view(self._config)
        elif self._far:
            self._look_far(ids)  # makes room for all, which threads couldn't

    def observe(self, ids: IntArray, is_published: BoolArray) -> Any:
        """The observations of all robots, those of ``ids`` made again.

        Args:
            ids: Those that have sensed.
            is_published: Whose map was published just now, shape (N,).
        """
        fleet = self._fleet
        if not fleet.is_mapped_together:
            divide_work(lambda part: self._look(part, is_published), ids, fleet.threads)
        elif self._far:
            divide_work(self._look_far, ids[is_published[ids]], fleet.threads)
            self._far.write(ids, fleet.maps.believed, self._seen)
        seen = self._seen.copy()
        if self._config.observation.preset != "dict":
            return seen
        return self._measurements.observe(
            seen,
            fleet.scans.ranges,
            fleet.maps.believed,
            fleet.robots.velocity,
            fleet.times[:, np.newaxis],
        )

    def _look_far(self, ids: IntArray) -> None:
        for i in ids.tolist():
            tiles = self._fleet.tiles(i)
            self._far.refresh(i, tiles.cells, tiles.corner, tiles.resolution)

    def _look(self, ids: IntArray, is_published: BoolArray) -> None:
        fleet = self._fleet
        for i in ids.tolist():
            now = SensedStep(
                mapper=fleet.mapper(i),
                ranges=fleet.scans.ranges[i],
                pose=Pose2D(*fleet.maps.believed[i].tolist()),
                velocity=Twist2D(*fleet.robots.velocity[i].tolist()),
                is_new=bool(fleet.maps.is_new[i]),
                is_published=bool(is_published[i]),
            )
            self._seen[i] = self._views[i].look(now)

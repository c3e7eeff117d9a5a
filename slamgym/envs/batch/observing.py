"""Observations of many robots: by kernels where kernels map, else each robot's map is looked at as by itself."""

from typing import Any

import numpy as np

from slamgym.core.types import BoolArray, IntArray, Pose2D
from slamgym.envs.batch.fleet import Fleet
from slamgym.envs.batch.kernels import compact_all, crop_all
from slamgym.envs.compact import MAP_TILE, CompactObserver
from slamgym.envs.config import ExploreConfig
from slamgym.envs.far_look import FarLook
from slamgym.envs.observations import MapView, dict_space, make_view, window_sizes


class BatchObserver:
    """Makes the observations of a fleet in the preset of the settings.

    Args:
        config: The settings.
        fleet: The robots.
    """

    def __init__(self, config: ExploreConfig, fleet: Fleet) -> None:
        count, observation = len(fleet), config.observation
        self._config, self._fleet = config, fleet
        self._compact = CompactObserver.of(config) if observation.is_compact else None
        self._far = FarLook(count) if observation.preset == "compact_far" else None
        self._space = dict_space(config)
        shape = self._compact.space.shape if self._compact else observation.shape
        self._seen: Any = np.zeros((count, *shape), np.float32 if self._compact else np.uint8)
        self._views: list[MapView] = []
        size, self._samples = window_sizes(observation, config.slam.resolution)
        width = 0 if self._compact or not fleet.is_mapped_together else 2 * size + 1
        self._windows = np.zeros((count, width, width), dtype=np.uint8)
        self._centres = np.zeros((count, 2))

    def begin(self, ids: IntArray) -> None:
        """Forget the maps of robots that begin an episode."""
        if self._fleet.is_mapped_together:
            return
        for i in ids.tolist():
            view = make_view(self._config)
            if i == len(self._views):
                self._views.append(view)
            else:
                self._views[i] = view

    def observe(self, ids: IntArray, is_published: BoolArray) -> Any:
        """The observations of all robots, those of ``ids`` made anew.

        Args:
            ids: Those that have sensed.
            is_published: Whose map was published just now, shape (N,).
        """
        if not self._fleet.is_mapped_together:
            self._look_one_by_one(ids, is_published)
        elif self._compact:
            self._write_compact(self._compact, ids)
            if self._far:
                for i in ids[is_published[ids]].tolist():
                    self._look_far(self._far, i)
        else:
            self._cut_crops(ids)
        if self._far:
            self._far.write(ids, self._fleet.maps.believed, self._seen)
        if self._config.observation.preset != "dict":
            return self._seen.copy()
        fleet = self._fleet
        ranges = np.clip(fleet.scans.ranges, np.float32(0.0), np.float32(self._config.lidar.range_max))
        return {
            "map": self._seen.copy(),
            "scan": ranges,
            "pose": self._within("pose", fleet.maps.believed),
            "velocity": self._within("velocity", fleet.robots.velocity),
            "time": fleet.times.astype(np.float32)[:, np.newaxis],
        }

    def _write_compact(self, compact: CompactObserver, ids: IntArray) -> None:
        fleet = self._fleet
        compact_all(
            fleet.robots, fleet.scans, fleet.maps, fleet.map_law.resolution, compact.side, compact.limits, ids,
            self._seen,
        )  # fmt: skip

    def _look_far(self, far: FarLook, index: int) -> None:
        """Look at a map that a kernel drew."""
        maps = self._fleet.maps
        (rows, cols), (row, col) = maps.shape[index].tolist(), maps.corner[index].tolist()
        rows, cols = rows // MAP_TILE, cols // MAP_TILE
        packed = maps.tiles[index, : rows * cols].reshape(rows, cols)
        far.refresh_packed(index, packed, (row, col), self._fleet.map_law.resolution)

    def _cut_crops(self, ids: IntArray) -> None:
        fleet, observation = self._fleet, self._config.observation
        crop_all(
            fleet.maps, self._windows, self._centres, fleet.map_law.resolution, observation.crop_resolution,
            self._samples, ids, self._seen,
        )  # fmt: skip

    def _look_one_by_one(self, ids: IntArray, is_published: BoolArray) -> None:
        fleet, new, published = self._fleet, self._fleet.maps.is_new.tolist(), is_published.tolist()
        for i in ids.tolist():
            mapper, view, believed = fleet.each[i].mapper, self._views[i], fleet.maps.believed[i]
            assert mapper is not None, "robots that are not mapped together have mappers"
            if self._compact:
                shown = view.lattice(mapper, new[i], published[i])
                self._compact.write(
                    shown, fleet.scans.ranges[i], believed, fleet.robots.velocity[i], self._seen[i]
                )
                if self._far and published[i]:
                    self._far.refresh(i, *shown)
            else:
                self._seen[i] = view.view(mapper, Pose2D(*believed.tolist()), new[i], published[i])

    def _within(self, name: str, values: Any) -> Any:
        limit = self._space[name].high.astype(np.float64)  # type: ignore[attr-defined]
        return np.clip(values, -limit, limit).astype(np.float32)

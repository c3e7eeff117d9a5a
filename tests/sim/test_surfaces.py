import dataclasses
import math

import numpy as np
import pytest
import shapely

from slamgym.cad import FloorPlan, PlanGeneratorConfig, generate_plan
from slamgym.core.errors import ConfigError
from slamgym.core.types import Pose2D
from slamgym.sim import (
    Lidar,
    LidarConfig,
    RobotConfig,
    SurfaceConfig,
    Surfaces,
    World,
    lidar_level,
    make_surfaces,
)
from slamgym.sim.lidar import REAL_SURFACES
from slamgym.sim.surfaces import GLASS, MIRROR, PLAIN

PLAN = generate_plan(3, PlanGeneratorConfig(kind="home"))
NOTHING = np.empty((0, 4))
WALL = np.array([(2.0, -5.0, 2.0, 5.0)])
BEHIND = np.array([(3.0, -9.0, 3.0, 9.0)])
EXACT = lidar_level("exact", LidarConfig(num_beams=181, mount=(0.0, 0.0, 0.0)))


def patched(kind, begin, end, echo=1.0, outside=NOTHING, segments=1):
    """One patch on the first segment."""
    first = np.array([0, *[1] * segments])
    return Surfaces(first, np.array([(begin, end, kind, echo, 0.0)]), outside, 0, 1, 0.0)


def ranges(surfaces, segments=WALL, config=EXACT, pose=Pose2D(0.0, 0.0, 0.0), seed=0):
    lidar = Lidar(config)
    sighting = lidar.look(pose, segments)
    scan = lidar.measure(sighting, np.random.default_rng(seed), 0.0, surfaces)
    return scan.ranges.astype(np.float64), sighting.ranges


class TestDrawing:
    def test_a_building_keeps_its_materials(self):
        one, other = (make_surfaces(PLAN, NOTHING, REAL_SURFACES) for _ in range(2))
        assert one.patches.tobytes() == other.patches.tobytes()
        again = make_surfaces(PLAN, NOTHING, dataclasses.replace(REAL_SURFACES, seed=1))
        assert one.patches.tobytes() != again.patches.tobytes()

    def test_panes_are_of_all_widths_and_the_view_through_them_ends_at_something(self):
        surfaces = make_surfaces(PLAN, NOTHING, SurfaceConfig(glazing=0.2))
        widths = surfaces.patches[:, 1] - surfaces.patches[:, 0]
        assert widths.min() < 0.4
        assert widths.max() > 1.2
        assert len(surfaces.outside) >= 5 * len(widths)
        reach = np.hypot(*(surfaces.outside[:, :2] - np.mean(PLAN.segments()[:, :2], axis=0)).T)
        assert reach.max() < 40.0

    def test_furniture_leaves_the_walls_as_they_are(self):
        chair = np.array([(1.0, 1.0, 1.4, 1.0), (1.4, 1.0, 1.4, 1.4), (1.4, 1.4, 1.0, 1.0)])
        empty, furnished = (
            make_surfaces(PLAN, pieces, REAL_SURFACES) for pieces in (NOTHING, chair)
        )
        assert np.array_equal(furnished.patches[: len(empty.patches)], empty.patches)
        assert len(furnished.first) == len(empty.first) + 3

    def test_a_piece_of_furniture_is_dark_as_a_whole(self):
        pieces = [
            np.array([(x, 0.0, x + 1, 0.0), (x + 1, 0.0, x, 1.0), (x, 1.0, x, 0.0)])
            for x in np.arange(0, 60, 2.0)
        ]
        surfaces = make_surfaces(PLAN, np.vstack(pieces), SurfaceConfig(dark=0.4))
        counts = np.diff(surfaces.first)[len(PLAN.segments()) :].reshape(-1, 3)
        assert set(counts.sum(axis=1).tolist()) == {0, 3}

    def test_glass_takes_its_share_of_the_outer_walls_and_none_of_the_inner(self):
        config = SurfaceConfig(glazing=0.3)
        glazed = outer = 0.0
        for seed in range(12):
            plan = generate_plan(seed, PlanGeneratorConfig(kind="home"))
            surfaces = make_surfaces(plan, NOTHING, config)
            hull = plan.free_space.minimum_rotated_rectangle.exterior
            for index, (x0, y0, x1, y1) in enumerate(plan.segments()):
                own = surfaces.patches[surfaces.first[index] : surfaces.first[index + 1]]
                length = float((own[:, 1] - own[:, 0]).sum())
                is_on_hull = all(
                    hull.distance(shapely.Point(x, y)) < 0.05 for x, y in ((x0, y0), (x1, y1))
                )
                if is_on_hull and math.hypot(x1 - x0, y1 - y0) > 0.6:
                    glazed, outer = glazed + length, outer + math.hypot(x1 - x0, y1 - y0)
        # Some 100 modules of 2.5 m, each glazed with probability 0.43: five standard errors are 0.17.
        assert glazed / outer == pytest.approx(0.3, abs=0.17)

    def test_too_much_of_everything_is_refused(self):
        with pytest.raises(ConfigError, match="glazing"):
            SurfaceConfig(glazing=0.6, dark=0.3)

    def test_contacts_know_nothing_of_glass(self):
        plain, glass = (
            World(PLAN, RobotConfig(), surfaces=surfaces)
            for surfaces in (
                None,
                make_surfaces(PLAN, np.empty((0, 4)), SurfaceConfig(glazing=0.3)),
            )
        )
        assert np.array_equal(plain.segments(), glass.segments())
        assert len(plain.building.surfaces.patches) == 0 < len(glass.building.surfaces.patches)


class TestMeasuring:
    def test_glass_shows_what_is_behind_but_for_a_beam_straight_on_it(self):
        measured, true = ranges(patched(GLASS, 0.0, 10.0, segments=2), np.vstack([WALL, BEHIND]))
        assert measured[90] == pytest.approx(2.0)
        oblique = slice(100, 115)
        behind = 3.0 / np.cos(np.radians(np.arange(10, 25)))
        seen_behind = np.isclose(measured[oblique], behind, atol=1e-4)
        # A part of the pane is dirty; all others see the wall behind.
        assert 0.6 < seen_behind.mean() < 1.0
        assert np.allclose(measured[oblique][~seen_behind], true[oblique][~seen_behind], atol=1e-4)

    def test_dirt_stays_where_it_is(self):
        surfaces = patched(GLASS, 0.0, 10.0)
        one, other = (ranges(surfaces, seed=seed)[0] for seed in (0, 1))
        assert np.array_equal(one, other)

    def test_things_outside_are_seen_through_glass_only(self):
        thing = np.array([(2.5, -9.0, 2.5, 9.0)])
        assert np.isclose(
            ranges(patched(GLASS, 0.0, 10.0, outside=thing))[0], 2.5 / math.cos(math.radians(20))
        ).any()
        measured, true = ranges(patched(PLAIN, 0.0, 10.0, outside=thing))
        assert np.array_equal(measured, true.astype(np.float32))

    def test_a_mirror_shows_the_room_behind_the_robot(self):
        back = np.array([(1.0, -9.0, 1.0, -2.0)])
        measured, _ = ranges(patched(MIRROR, 0.0, 10.0, segments=2), np.vstack([WALL, back]))
        # 45 degrees to the right: 2 m ahead at the mirror, 1 m back from it.
        assert measured[45] == pytest.approx(
            3.0 * math.sqrt(2.0) if 3.0 * math.sqrt(2.0) <= 3.5 else np.inf
        )
        wide = lidar_level(
            "exact", LidarConfig(num_beams=181, mount=(0.0, 0.0, 0.0), range_max=8.0)
        )
        measured, _ = ranges(patched(MIRROR, 0.0, 10.0, segments=2), np.vstack([WALL, back]), wide)
        assert measured[45] == pytest.approx(3.0 * math.sqrt(2.0), abs=1e-4)

    def test_echoes_are_lost_far_off_obliquely_and_on_dark_surfaces(self):
        config = dataclasses.replace(EXACT, attenuation=0.1)
        white, true = ranges(patched(PLAIN, 0.0, 0.0), config=config)
        dark, _ = ranges(patched(PLAIN, 0.0, 10.0, echo=0.01), config=config)
        assert np.isfinite(white[60:120]).all()
        assert np.isinf(dark[np.isfinite(true)]).all()
        flat = np.array([(-5.0, 0.5, 5.0, 0.5)])
        config = dataclasses.replace(EXACT, attenuation=2.0)
        grazing, true = ranges(patched(PLAIN, 0.0, 0.0), flat, config)
        straight, oblique = slice(150, 181), (true > 3.0) & np.isfinite(true)
        assert np.isfinite(grazing[straight]).all()
        assert oblique.any()
        assert np.isinf(grazing[oblique]).all()

    def test_an_edge_gives_a_range_in_between(self):
        config = dataclasses.replace(EXACT, beam_width_deg=1.0)
        near = np.array([(1.5, -9.0, 1.5, 0.001)])
        far = np.array([(2.0, -9.0, 2.0, 9.0)])
        measured, true = ranges(patched(PLAIN, 0.0, 0.0), np.vstack([near, far]), config)
        assert true[90] == pytest.approx(1.5)
        assert measured[90] == pytest.approx(1.75, abs=0.05)
        assert np.array_equal(
            np.delete(measured, [90, 91]), np.delete(true, [90, 91]).astype(np.float32)
        )

    def test_evenness_is_of_the_size_asked_for_and_stays(self):
        surfaces = make_surfaces(_hall(), NOTHING, SurfaceConfig(roughness=0.005))
        config = dataclasses.replace(EXACT, range_max=30.0)
        walls = np.asarray(_hall().segments())
        one, true = ranges(surfaces, walls, config, Pose2D(10.0, 10.0, 0.0))
        other, _ = ranges(surfaces, walls, config, Pose2D(10.0, 10.0, 0.0), seed=1)
        assert np.array_equal(one, other)
        # One scan of some 80 independent places.
        assert (one - true)[45:135].std() == pytest.approx(0.0055, rel=0.4)


def _hall():
    return FloorPlan("hall", shapely.box(0.0, 0.0, 20.0, 20.0))

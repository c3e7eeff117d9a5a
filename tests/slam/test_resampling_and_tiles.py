"""Resampling is unbiased, and maps that share tiles behave as copies would."""

import math
from collections import defaultdict

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slamgym.slam.hill_climbing import exp_of_minus, nearest_square, score
from slamgym.slam.particles import (
    ParticleMaps,
    effective_sample_size,
    normalized_weights,
    systematic_resample,
)
from slamgym.slam.tiles import EMPTY, register_scan

log_weights = st.lists(st.floats(-1e4, 0.0), min_size=1, max_size=40).map(np.array)


@given(log_weights)
def test_weights_sum_to_one_and_keep_their_order(logs):
    weights = normalized_weights(logs)
    assert math.isclose(weights.sum(), 1.0)
    assert 1.0 - 1e-9 <= effective_sample_size(weights) <= len(logs) + 1e-9
    order = np.argsort(logs)
    assert np.all(np.diff(weights[order]) >= 0.0)


@given(log_weights, st.floats(0.0, 1.0, exclude_max=True))
def test_each_particle_survives_as_often_as_its_weight_says(logs, uniform):
    weights = normalized_weights(3.0 * len(logs) * logs)
    ancestors = systematic_resample(weights, uniform)
    copies = np.bincount(ancestors, minlength=len(weights))
    # Systematic resampling: the whole part of N w for sure, one more by chance (rounding aside).
    assert copies.sum() == len(weights)
    assert np.all(copies >= np.floor(len(weights) * weights - 1e-6))
    assert np.all(copies <= np.ceil(len(weights) * weights + 1e-6))
    stay = np.flatnonzero(copies)
    assert np.all(ancestors[stay] == stay)  # survivors stay where they are


def test_resampling_is_unbiased_over_its_draw():
    weights = np.array([0.05, 0.15, 0.3, 0.5])
    draws = [
        np.bincount(systematic_resample(weights, u), minlength=4)
        for u in (np.arange(1000) + 0.5) / 1000
    ]
    np.testing.assert_allclose(np.mean(draws, axis=0), 4 * weights, atol=4e-3)


class DenseMaps:
    """The same maps as plain dictionaries, copied whole at resampling."""

    def __init__(self, particles, resolution):
        self.maps = [defaultdict(list) for _ in range(particles)]
        self.resolution = resolution

    def register(self, poses, points):
        for cells, (x, y, theta) in zip(self.maps, poses, strict=True):
            cos, sin = math.cos(theta), math.sin(theta)
            for px, py in points:
                u = (x + cos * px - sin * py) / self.resolution
                v = (y + sin * px + cos * py) / self.resolution
                cells[math.floor(u), math.floor(v)].append((u, v))

    def resample(self, ancestors):
        copies = [{key: list(value) for key, value in self.maps[a].items()} for a in ancestors]
        self.maps = [defaultdict(list, copy) for copy in copies]

    def nearest(self, particle, u, v):
        means = [
            np.mean(self.maps[particle][near], axis=0)
            for near in (
                (math.floor(u) + du, math.floor(v) + dv) for du in (-1, 0, 1) for dv in (-1, 0, 1)
            )
            if near in self.maps[particle]
        ]
        return min((float((m[0] - u) ** 2 + (m[1] - v) ** 2) for m in means), default=-1.0)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_shared_tiles_behave_as_copied_maps(seed):
    rng = np.random.default_rng(seed)
    particles, resolution = 4, 0.05
    shared, dense = ParticleMaps(particles, resolution, 100.0), DenseMaps(particles, resolution)
    for _ in range(6):
        poses = rng.uniform([-3, -3, -3], [3, 3, 3], (particles, 3))
        points = rng.uniform(-1.5, 1.5, (12, 2))
        shared.cover(poses, 4.0)
        shared.register(poses, points)
        dense.register(poses, points)
        if rng.random() < 0.6:
            weights = rng.dirichlet(np.ones(particles))
            ancestors = systematic_resample(weights, float(rng.random()))
            shared.resample(ancestors)
            dense.resample(ancestors)
    origin = shared.origin
    for particle in range(particles):
        for cell in list(dense.maps[particle])[:20]:
            u, v = cell[0] + rng.random(), cell[1] + rng.random()
            place = np.array([u, v]) - origin / resolution
            found = nearest_square(shared.pool.cells, shared.tables[particle], *place)
            expected = dense.nearest(particle, u, v)
            # Means are kept in 16 bits: a few hundred-thousandths of a cell.
            assert math.isclose(math.sqrt(found), math.sqrt(expected), abs_tol=1e-3)


def test_a_score_is_given_up_only_where_it_cannot_win():
    rng = np.random.default_rng(3)
    maps, pose = ParticleMaps(1, 0.05, 100.0), np.zeros((1, 3))
    maps.cover(pose, 8.0)
    maps.register(pose, rng.uniform(-6.0, 6.0, (2000, 2)))
    cells, table = maps.pool.cells, maps.tables[0]
    for _ in range(10):
        points = rng.uniform(-140.0, 140.0, (2, 300))
        u, v = -maps.origin / 0.05 + rng.normal(0.0, 3.0, 2)
        squares = [nearest_square(cells, table, u + x, v + y) for x, y in points.T]
        expected = sum(exp_of_minus(0.05 * square) for square in squares if square < math.inf)
        assert math.isclose(score(cells, table, points, u, v, 0.05, -1.0), expected, abs_tol=1e-9)
        assert score(cells, table, points, u, v, 0.05, expected + 1.0) <= expected + 1.0


def cells_of(maps, particle):
    """All that a particle's map holds, copied."""
    return maps.pool.cells[maps.tables[particle]].copy()


def check_accounts(maps):
    """Every tile is counted by those who name it; what nobody names is free, once."""
    named = np.bincount(maps.tables.ravel(), minlength=len(maps.pool.references))
    named[EMPTY] = 0
    np.testing.assert_array_equal(maps.pool.references, named)
    free = maps.pool.free[: int(maps.pool.num_free[0])]
    assert sorted(free) == [tile for tile in range(1, len(named)) if named[tile] == 0]
    assert not maps.pool.cells[EMPTY].any()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_write_to_one_map_never_changes_another(seed):
    rng = np.random.default_rng(seed)
    maps, particles = ParticleMaps(4, 0.05, 100.0), 4
    maps.cover(np.zeros((particles, 3)), 4.0)
    for _ in range(5):
        writer = int(rng.integers(particles))
        before = [cells_of(maps, particle) for particle in range(particles)]
        pose, points = rng.uniform([-2, -2, -3], [2, 2, 3], (1, 3)), rng.uniform(-1.5, 1.5, (20, 2))
        own = maps.tile_maps._replace(tables=maps.tables[writer : writer + 1])
        assert register_scan(own, pose, points, 0) == 1
        check_accounts(maps)
        for particle in range(particles):
            unchanged = np.array_equal(cells_of(maps, particle), before[particle])
            assert unchanged == (particle != writer)
        ancestors = systematic_resample(rng.dirichlet(np.ones(particles)), float(rng.random()))
        before = [cells_of(maps, particle) for particle in range(particles)]
        maps.resample(ancestors)
        check_accounts(maps)
        for particle, ancestor in enumerate(ancestors):
            assert np.array_equal(cells_of(maps, particle), before[ancestor])


def test_a_grown_pool_and_a_grown_table_hold_what_they_held():
    maps = ParticleMaps(3, 0.05, 100.0)
    rng = np.random.default_rng(0)
    poses, points = rng.uniform(-1, 1, (3, 3)), rng.uniform(-2, 2, (60, 2))
    maps.cover(poses, 4.0)
    maps.register(poses, points)
    before = [maps.pool.cells[table[table != EMPTY]].copy() for table in maps.tables]
    origin = maps.origin
    maps.cover(poses + np.array([-20.0, 30.0, 0.0]), 4.0)
    maps.pool = maps.pool.grown(5000)
    check_accounts(maps)
    assert (maps.origin <= origin).all()
    assert (maps.origin < origin).any()
    for table, cells in zip(maps.tables, before, strict=True):
        np.testing.assert_array_equal(maps.pool.cells[table[table != EMPTY]], cells)


def test_resampling_shares_tiles_instead_of_copying_them():
    maps = ParticleMaps(50, 0.05, 100.0)
    poses = np.zeros((50, 3))
    points = np.random.default_rng(0).uniform(-5, 5, (500, 2))
    maps.cover(poses, 8.0)
    maps.register(poses[:1].repeat(50, axis=0), points)
    free_before = int(maps.pool.num_free[0])
    maps.resample(np.zeros(50, dtype=np.int64))
    # All follow the first now: the tiles of 49 maps came free and none was taken.
    tiles = np.count_nonzero(maps.tables[0])
    assert int(maps.pool.num_free[0]) == free_before + 49 * tiles

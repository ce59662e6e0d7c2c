"""Voxels against a dictionary of cells."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
from slopewatch.models.preparation.voxels import morton, voxel_grid


def test_voxels_are_the_means_of_their_cells():
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-3, 3, (5000, 3)) + (500_000, 3_000_000, 40)
    values = rng.integers(0, 4, 5000).astype(np.uint8)
    grid = voxel_grid(xyz, 0.7)
    cells = defaultdict(list)
    for number, cell in enumerate(map(tuple, np.floor(xyz * (1 / 0.7)).astype(int))):
        cells[cell].append(number)
    assert len(grid.points) == len(cells)
    majority = grid.majority(values, 4)
    for members in cells.values():
        voxel = grid.inverse[members]
        assert (voxel == voxel[0]).all()
        assert grid.count[voxel[0]] == len(members)
        np.testing.assert_allclose(grid.points[voxel[0]], xyz[members].mean(axis=0), atol=1e-8)
        most = Counter(values[members].tolist())
        assert majority[voxel[0]] == min(v for v, n in most.items() if n == max(most.values()))


def test_the_morton_code_takes_bits_in_turn():
    i, j = (np.random.default_rng(k).integers(0, 2**20, 200) for k in (2, 3))
    for a, b, code in zip(i.tolist(), j.tolist(), morton(i, j).tolist()):
        expected = sum((((a >> bit) & 1) << (2 * bit)) | (((b >> bit) & 1) << (2 * bit + 1)) for bit in range(20))
        assert code == expected


def test_neighbours_in_memory_are_neighbours_in_space():
    points = voxel_grid(np.random.default_rng(4).uniform(0, 20, (40_000, 3)) * (1, 1, 0), 0.25).points
    assert np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)) < 0.5

"""Voxel averages against a dictionary of cells."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.geometry.voxels import block_numbers, voxel_average


def test_means_are_those_of_a_dictionary_of_cells():
    xyz = np.random.default_rng(0).normal(0, 1, (3000, 3))
    size = 0.37
    low = xyz.min(axis=0) - 0.381966 * size
    cells = defaultdict(list)
    for point in xyz:
        cells[tuple(np.floor((point - low) / size).astype(int))].append(point)
    expected = np.array([np.mean(cells[key], axis=0) for key in sorted(cells)])
    assert np.abs(voxel_average(xyz, size) - expected).max() < 1e-12


def test_coordinates_in_millimetres_fall_into_the_same_voxels_wherever_the_origin_is():
    xyz = np.round(np.random.default_rng(1).uniform(0, 20, (20_000, 3)), 3)
    here = voxel_average(xyz, 0.1)
    # far away each coordinate is off by its last digit, which would move points on a face into the next voxel
    there = voxel_average(xyz + [512_345.678, 4_123_456.789, 1_234.5], 0.1)
    assert here.shape == there.shape
    assert np.abs(here - (there - [512_345.678, 4_123_456.789, 1_234.5])).max() < 1e-8


def test_an_absurd_extent_is_refused():
    with pytest.raises(InputError, match="stray"):
        voxel_average(np.array([[0.0, 0.0, 0.0], [1e9, 1e9, 1e9]]), 0.01)


def test_blocks_are_counted_without_gaps():
    xyz = np.array([[0.1, 0.1, 0.0], [5.2, 0.1, 0.0], [0.9, 0.9, 0.0], [5.9, 0.0, 0.1]])
    number = block_numbers(xyz, 1.0)
    assert number[0] == number[2]
    assert number[1] == number[3]
    assert set(number) == {0, 1}


@pytest.mark.parametrize("stray", [3.0, 1e6])
def test_blocks_are_counted_without_gaps_however_far_a_stray_point_lies(stray):
    xyz = np.vstack([np.random.default_rng(2).uniform(0, 2, (500, 3)), [[stray, 0.5, stray]]])
    cells = [tuple(cell) for cell in np.floor((xyz - xyz.min(axis=0)) / 0.25).astype(int)]
    expected = {cell: number for number, cell in enumerate(sorted(set(cells)))}
    assert block_numbers(xyz, 0.25).tolist() == [expected[cell] for cell in cells]

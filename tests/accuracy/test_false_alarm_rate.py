"""Unchanged surveys: the 95 % level is exceeded by 3 to 7 % of the cells in every class of slope.

A grown cell is one, however many cells of the raster it covers.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.result import Change
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import ChangeParameters, InputParameters, SurveyParameters
from slopewatch.lab.benchmarks.chain import inside
from slopewatch.simulation.surveys.survey import simulate_pair

FEWEST = 500  # cells of a class: their share is known to 1 %


def shares(change: Change, where: np.ndarray | None = None) -> dict[int, float]:
    """Share of the cells beyond their level, by the class of slope that starts at so many degrees."""
    return {low: share for low, (share, cells) in counted(change, where).items() if cells >= FEWEST}


def counted(change: Change, where: np.ndarray | None = None) -> dict[int, tuple[float, int]]:
    """The same of all classes that have any, with the number of their cells."""
    all_of_them = change.valid if where is None else change.valid & where
    all_of_them = change.partition.middles(all_of_them)
    found = {}
    for low, high in pairwise((0, 15, 30, 45, 60, 90)):
        cells = all_of_them & (change.slope >= low) & (change.slope < high)
        if cells.any():
            found[low] = float(change.significant[cells].mean()), int(cells.sum())
    return found


@pytest.fixture(scope="module", params=[(33, 0.7), (52, 0.3)], ids=lambda p: f"{p[0]} degrees")
def unchanged(request) -> tuple[np.ndarray, np.ndarray]:
    """Ground points of two surveys of a road, a cut face with a berm, and a shoulder, with plants."""
    angle, vegetation = request.param
    parameters = SurveyParameters(
        seed=5, points=250_000, length=30.0, height=14.0, angle=angle, benches=1, vegetation=vegetation,
        amplitude=0.0, offset=0.0,
    )  # fmt: skip
    pair = simulate_pair(parameters, roi_buffer=3.0)
    first, second = (
        cloud.xyz[inside(cloud.xyz, pair) & cloud.truth_ground.astype(bool)] for cloud in (pair.first, pair.second)
    )
    return first, second


@pytest.mark.parametrize("cell", [0.1, 0.25])
@pytest.mark.parametrize("statistic", ["plane", "mean"])
def test_simulated_surveys(unchanged, cell, statistic):
    found = shares(difference(*unchanged, ChangeParameters(cell=cell, cell_value=statistic, adaptive=False)))
    assert len(found) >= 2
    assert all(0.03 <= share <= 0.07 for share in found.values()), found


@pytest.mark.parametrize("cell", [0.1, 0.25])
def test_simulated_surveys_in_cells_that_grow(unchanged, cell):
    found = shares(difference(*unchanged, ChangeParameters(cell=cell)))
    assert len(found) >= 2
    assert all(0.03 <= share <= 0.07 for share in found.values()), found


@pytest.mark.parametrize("adaptive", [False, True])
def test_along_the_normal(unchanged, adaptive):
    found = shares(difference(*unchanged, ChangeParameters(cell=0.25, direction="normal", adaptive=adaptive)))
    assert len(found) >= 2
    assert all(0.03 <= share <= 0.07 for share in found.values()), found


def test_change_of_a_quarter_of_the_slope_does_not_widen_the_level(unchanged):
    """Lowered by 10 cm between two lines across the slope: elsewhere the level holds as without."""
    first, second = unchanged
    x = second[:, 0] - second[:, 0].min()
    lines = np.quantile(x, [0.4, 0.65])
    moved = second - np.outer((x > lines[0]) & (x < lines[1]), [0.0, 0.0, 0.1])
    change = difference(first, moved, ChangeParameters(cell=0.25))
    without = difference(first, second, ChangeParameters(cell=0.25))
    west = change.grid.west + (np.arange(change.grid.columns) + 0.5) * change.grid.cell - second[:, 0].min()
    still = np.broadcast_to((west < lines[0] - 0.5) | (west > lines[1] + 0.5), change.grid.shape)
    found = shares(change, still)
    assert len(found) >= 2
    assert all(0.03 <= share <= 0.07 for share in found.values()), found
    assert change.median_level == pytest.approx(without.median_level, rel=0.05)
    assert change.significant[~still & change.valid].mean() > 0.8


def test_the_steep_face_is_measured_as_well_as_the_road(unchanged):
    """The slope's own rise within a cell is no error of the height at its centre."""
    first, second = unchanged
    published = difference(first, second, ChangeParameters(cell=0.25, cell_value="mean", calibrate=False))
    own = difference(first, second, ChangeParameters(cell=0.25, adaptive=False))
    steep = own.valid & (own.slope > 30)
    scatter = [float(np.quantile(np.abs(change.dz[steep]), 0.68)) for change in (own, published)]
    assert scatter[0] < 0.6 * scatter[1]
    assert np.median(own.level[steep]) < 0.6 * np.median(published.level[steep])


@pytest.fixture
def halves(shared_data: Path) -> tuple[np.ndarray, np.ndarray]:
    cloud = read_cloud(shared_data / "real" / "lone-star.copc.laz", InputParameters(crs="EPSG:32614")).xyz
    half = np.random.default_rng(1).permutation(len(cloud)) < len(cloud) // 2
    return cloud[half], cloud[~half]


@pytest.mark.parametrize("cell", [0.1, 0.25])
def test_a_real_cloud_in_two_halves(halves, cell):
    found = shares(difference(*halves, ChangeParameters(cell=cell, adaptive=False)))
    assert len(found) >= 4
    assert all(0.03 <= share <= 0.07 for share in found.values()), found


@pytest.mark.parametrize("cell", [0.1, 0.25])
def test_a_real_cloud_in_two_halves_in_cells_that_grow(halves, cell):
    """On its walls few cells are left: there the share is known no better than their number allows."""
    found = counted(difference(*halves, ChangeParameters(cell=cell)))
    assert len(found) == 5
    for share, cells in found.values():
        assert abs(share - 0.05) <= 0.02 + 2 * np.sqrt(0.05 * 0.95 / cells), found

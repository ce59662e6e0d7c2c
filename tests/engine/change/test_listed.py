"""A change on the cells of the slope is that on the whole rectangle around it, and takes the slope's memory."""

from __future__ import annotations

import tracemalloc
from dataclasses import fields, replace
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.change import difference as module
from slopewatch.engine.change.coverage import common_rate_at, seen
from slopewatch.engine.change.difference import difference, listed_difference
from slopewatch.engine.change.result import Change
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.grid import tiled_points
from slopewatch.engine.grid.growing_cells import AdaptiveCells, adaptive_cells
from slopewatch.engine.report.facts import change_facts, error_terms
from slopewatch.engine.statistics import variogram
from slopewatch.engine.zones.change_zones import cells_of, change_zones
from slopewatch.engine.zones.gcd_table import volume_table
from slopewatch.interface.parameters import ChangeParameters
from slopewatch.tests.builders.equal_results import same
from slopewatch.tests.builders.turned_slope import turned_slope

PARAMETERS = ChangeParameters(cell=0.2)
DAYS = date(2024, 5, 1), date(2025, 5, 1)


def laid_out(cells: AdaptiveCells) -> AdaptiveCells:
    """The same cells in arrays of the whole rectangle."""
    on_grid = cells.partition.layout.on_grid
    values = {f.name: getattr(cells, f.name) for f in fields(cells)}
    arrays = {name: on_grid(v) for name, v in values.items() if isinstance(v, np.ndarray)}
    return replace(
        cells,
        **arrays,
        points=(on_grid(cells.points[0]), on_grid(cells.points[1])),
        plants=cells.plants.laid_out(on_grid),
        partition=cells.partition.whole(),
    )


@pytest.fixture(scope="module")
def both() -> tuple[Change, Change]:
    """The change listed, and as one rectangle from the first step after the cells on."""
    (first, cover), (second, later) = turned_slope(90.0)
    listed = listed_difference(first, second, PARAMETERS, plants=(cover, later))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "adaptive_cells", lambda *given, **options: laid_out(adaptive_cells(*given, **options)))
        rectangle = listed_difference(first, second, PARAMETERS, plants=(cover, later))
    return listed, rectangle


def test_every_cell_is_judged_as_on_the_rectangle(both):
    listed, rectangle = both
    assert listed.layout.listed is not None
    assert rectangle.layout.listed is None
    assert listed.layout.listed.size < 0.5 * rectangle.dz.size
    assert listed.model.kind == "calibrated"
    assert listed.explained is not None
    assert listed.explained.any()
    same(listed.whole(), rectangle, "change")


def test_figures_and_shares_are_those_of_the_rectangle(both):
    listed, rectangle = both
    epochs = Epoch(Path("a"), DAYS[0]), Epoch(Path("b"), DAYS[1])
    crs = CRS.from_epsg(32651)
    zones = change_zones(rectangle, crs, epochs=DAYS)
    facts = [change_facts(c, zones.frame, epochs, crs, 0.3) for c in both]
    assert facts[0] == facts[1]
    assert error_terms(listed) == error_terms(rectangle)
    assert np.array_equal(seen(listed).classes, seen(rectangle).classes)
    assert common_rate_at(listed, 3) == common_rate_at(rectangle, 3)


@pytest.mark.parametrize("lattice", [1 << 20, 1 << 12], ids=["all cells", "thinned for long lags"])
def test_zones_and_volumes_are_those_of_the_rectangle(both, monkeypatch, lattice):
    monkeypatch.setattr(variogram, "_MAX_LATTICE_CELLS", lattice)
    found = [change_zones(c, epochs=DAYS) for c in both]
    assert len(found[0].frame) >= 5
    assert found[0].frame.drop(columns="geometry").equals(found[1].frame.drop(columns="geometry"))
    assert (found[0].frame.geometry == found[1].frame.geometry).all()
    np.testing.assert_array_equal(found[0].labels, found[1].labels)
    assert found[0].correlation.variogram is not None
    tables = [
        volume_table(cells_of(c), c.significant, z.volumes, z.correlation).rows()
        for c, z in zip(both, found, strict=True)
    ]
    for one, other in zip(*tables, strict=True):
        for f in fields(one):
            a, b = getattr(one, f.name), getattr(other, f.name)
            assert a == (b if b is None or isinstance(b, str) else pytest.approx(b, rel=1e-12)), one.quantity


def test_parts_of_the_slope_leave_no_seam(both, monkeypatch):
    """In parts of 6.4 m instead of all at once; the last digits depend on where sums of a part begin."""
    monkeypatch.setattr(tiled_points, "_AT_ONCE", 1)
    monkeypatch.setattr(tiled_points, "_TILE", 32)
    (first, cover), (second, later) = turned_slope(90.0)
    parts, whole = difference(first, second, PARAMETERS, plants=(cover, later)), both[0].whole()
    assert np.array_equal(parts.partition.block, whole.partition.block)
    for name in ("dz", "error", "level", "height_to", "slope"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-9, atol=1e-9, err_msg=name)
    for name in ("significant", "stable", "count_from", "count_to", "explained"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("lay_out", [False, True], ids=["listed", "rectangle"])
def test_memory_follows_the_slope_and_not_the_rectangle(monkeypatch, lay_out):
    """Three times the length is nine times the rectangle; on the rectangle the memory a cell of the slope grows."""
    monkeypatch.setattr(tiled_points, "_AT_ONCE", 1)
    monkeypatch.setattr(tiled_points, "_TILE", 64)
    monkeypatch.setattr(variogram, "_MAX_LATTICE_CELLS", 1 << 12)
    if lay_out:
        monkeypatch.setattr(module, "adaptive_cells", lambda *a, **options: laid_out(adaptive_cells(*a, **options)))
    peaks = []
    for length in (60.0, 180.0):
        (first, cover), (second, later) = turned_slope(length, density=8.0)
        tracemalloc.start()
        try:
            change = listed_difference(first, second, PARAMETERS, plants=(cover, later))
            change_zones(change)
            peaks.append(tracemalloc.get_traced_memory()[1] / int(change.valid.sum()))
        finally:
            tracemalloc.stop()
    assert (peaks[1] > 1.5 * peaks[0]) == lay_out


def test_two_real_tiles_that_touch_are_compared_without_a_seam(shared_data, monkeypatch):
    """Every second ground point against the others, over both tiles: in parts of 32 cells as in one piece."""
    files = [shared_data / f"real/ign_tiles/test_data_77050_{tile}_LA93_IGN69.laz" for tile in ("627755", "627760")]
    clouds = [laspy.read(path) for path in files]
    ground = [cloud.xyz[np.asarray(cloud.classification) == 2] for cloud in clouds]
    together = np.vstack(ground)
    parameters = ChangeParameters(cell=0.5)
    whole = difference(together[::2], together[1::2], parameters)
    monkeypatch.setattr(tiled_points, "_AT_ONCE", 1)
    monkeypatch.setattr(tiled_points, "_TILE", 32)
    parts = difference(together[::2], together[1::2], parameters)
    assert whole.valid.mean() > 0.3
    assert np.array_equal(parts.partition.block, whole.partition.block)
    for name in ("dz", "error", "level"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-9, atol=1e-9, err_msg=name)
    assert np.array_equal(parts.significant, whole.significant)

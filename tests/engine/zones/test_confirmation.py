"""The word about a screened zone, against every cell counted one by one with shapely."""

from __future__ import annotations

import math
from dataclasses import replace

import geopandas as gpd
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.change.result import Change
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.zones.confirmation import VERDICTS, Evidence, confirm_zones, verdict, weigh

WEST, NORTH = 500_000.0, 3_500_000.0


def changed(dz: np.ndarray, significant: np.ndarray, cell: float, *, uniform: float | None = None) -> Change:
    ones, counts = np.full(dz.shape, 0.02), np.full(dz.shape, 5)
    return Change(
        grid=Grid(WEST, NORTH, cell, *dz.shape),
        partition=Partition((dz.shape[0], dz.shape[1]), cell),
        dz=dz,
        error=ones,
        level=1.96 * ones,
        significant=significant & np.isfinite(dz),
        count_from=counts,
        count_to=counts,
        height_from=ones,
        height_to=ones,
        confidence=0.95,
        registration_error=0.0,
        common_cell_rate=1.0,
        uniform_dz=uniform,
        stable=~significant,
        slope=np.zeros(dz.shape),
    )


def zones(*shapes: tuple[str, shapely.Geometry]) -> gpd.GeoDataFrame:
    kinds, geometries = zip(*shapes, strict=True)
    return gpd.GeoDataFrame({"kind": list(kinds)}, geometry=list(geometries), crs=CRS(32651))


def box(column: float, row: float, width: float, height: float) -> shapely.Geometry:
    """In metres from the upper left corner."""
    return shapely.box(WEST + column, NORTH - row - height, WEST + column + width, NORTH - row)


def counted(geometry: shapely.Geometry, sign: float, change: Change) -> Evidence:
    """Cell by cell: the area of each cell's intersection with the zone."""
    grid, total, matching, opposite, weighted = change.grid, 0.0, 0.0, 0.0, 0.0
    for row in range(grid.rows):
        for column in range(grid.columns):
            dz = change.dz[row, column]
            part = geometry.intersection(box(column * grid.cell, row * grid.cell, grid.cell, grid.cell)).area
            if math.isnan(dz) or not part:
                continue
            total += part
            if change.significant[row, column]:
                weighted += part * dz
                if (dz > 0) == (sign > 0):
                    matching += part
                else:
                    opposite += part
    moved = matching + opposite
    return Evidence(
        total / geometry.area,
        total / grid.cell**2,
        matching / total if total else math.nan,
        opposite / total if total else math.nan,
        weighted / moved if moved else math.nan,
    )


@pytest.mark.parametrize("cell", [0.125, 0.25, 0.5, 1.0])
def test_shares_are_those_of_the_cells_counted_one_by_one(cell):
    rng = np.random.default_rng(int(1000 * cell))
    size = int(8 / cell)
    dz = rng.normal(0.02, 0.1, (size, size))
    dz[rng.random(dz.shape) < 0.3] = np.nan
    change = changed(dz, np.abs(dz) > 0.08, cell)
    for _ in range(6):
        # outlines of screened zones follow cells of 0.25 m; some reach beyond the raster
        parts = [
            box(*(0.25 * rng.integers(-4, 28, 2)), *(0.25 * rng.integers(2, 12, 2))) for _ in range(rng.integers(1, 4))
        ]
        outline = shapely.unary_union(parts)
        sign = float(rng.choice([-1.0, 1.0]))
        found = weigh(outline, sign, change, outline_cell=0.25)
        np.testing.assert_allclose(
            [found.compared, found.cells, found.matching, found.opposite, found.mean],
            list(vars(counted(outline, sign, change)).values()),
            atol=1e-6,
        )


def test_finer_cells_than_the_outline_count_by_their_middle():
    rng = np.random.default_rng(3)
    dz = rng.normal(0.0, 0.1, (40, 40))
    change = changed(dz, np.abs(dz) > 0.1, 0.1)
    outline = box(0.25, 0.5, 2.75, 1.5)
    found = weigh(outline, 1.0, change, outline_cell=0.25)
    middle = (np.arange(40) + 0.5) * 0.1
    inside = ((middle > 0.5) & (middle < 2.0))[:, None] & ((middle > 0.25) & (middle < 3.0))[None]
    assert found.cells == inside.sum()
    assert found.matching == pytest.approx((inside & (dz > 0.1)).sum() / inside.sum())
    assert found.opposite == pytest.approx((inside & (dz < -0.1)).sum() / inside.sum())


def uniform_zone(share: float, dz: float, *, known: float = 1.0) -> Change:
    """10 x 10 cells of 0.5 m of which a share changed by ``dz``, and only a part was measured."""
    values, significant = np.zeros(100), np.zeros(100, bool)
    values[int(100 * known) :] = np.nan
    significant[: round(100 * known * share)] = True
    values[significant] = dz
    return changed(values.reshape(10, 10), significant.reshape(10, 10), 0.5)


@pytest.mark.parametrize(
    ("kind", "share", "dz", "known", "word"),
    [
        ("uplift", 0.30, 0.1, 1.0, "confirmed"),
        ("uplift", 0.29, 0.1, 1.0, "confirmed in part"),
        ("uplift", 0.15, 0.1, 1.0, "confirmed in part"),
        ("uplift", 0.14, 0.1, 1.0, "not confirmed"),
        ("subsidence", 0.30, -0.1, 1.0, "confirmed"),
        ("subsidence", 0.29, -0.1, 1.0, "confirmed in part"),
        ("subsidence", 0.29, -0.1, 0.35, "not confirmed"),
        ("subsidence", 0.50, 0.1, 1.0, "not confirmed"),
        ("subsidence", 0.51, 0.1, 1.0, "contradicted"),
        ("uplift", 0.51, -0.1, 1.0, "contradicted"),
        ("uplift", 0.0, 0.0, 1.0, "not confirmed"),
        ("uplift", 1.0, 0.1, 0.25, "confirmed"),
        ("uplift", 1.0, 0.1, 0.24, "not measured"),
        ("uplift", 0.0, 0.0, 0.0, "not measured"),
    ],
)
def test_the_word_follows_the_shares(kind, share, dz, known, word):
    zone = zones((kind, box(0, 0, 5, 5)))
    row = confirm_zones(zone, uniform_zone(share, dz, known=known), outline_cell=0.25).iloc[0]
    assert row["confirmed"] == word
    assert row["compared_share"] == pytest.approx(known)
    if share and known:
        assert row["dz_signif_m"] == pytest.approx(dz)
        matches = (dz > 0) == (kind == "uplift")
        assert row["change_share" if matches else "opposite_share"] == pytest.approx(share, abs=0.02)
        assert row["opposite_share" if matches else "change_share"] == 0


def test_four_cells_tell_nothing_and_five_do():
    change = changed(np.full((5, 5), 0.3), np.ones((5, 5), bool), 0.5)
    frame = zones(("uplift", box(0, 0, 1.0, 1.0)), ("uplift", box(0, 0, 2.5, 0.5)))
    assert list(confirm_zones(frame, change, outline_cell=0.25)["confirmed"]) == ["not measured", "confirmed"]


def test_cells_of_a_grown_block_are_one_witness():
    single = changed(np.full((8, 8), 0.3), np.ones((8, 8), bool), 0.5)
    block = np.arange(4).reshape(2, 2).repeat(4, axis=0).repeat(4, axis=1)
    sliver = block.copy()
    sliver[3, 3] = 4
    finer = np.where(block == 0, 4 + np.arange(64).reshape(8, 8), block)
    five = np.where(block == 0, 4 + (np.arange(8) > 1)[:, None], block)
    frame = zones(("uplift", box(0, 0, 4, 4)))
    words = [
        confirm_zones(frame, replace(single, partition=p), outline_cell=0.25)["confirmed"].iloc[0]
        for p in (
            single.partition,
            *(
                Partition.of_blocks(b, 0.5)
                for b in (block, sliver, five, np.arange(64).reshape(8, 8), np.arange(64).reshape(8, 8) // 12)
            ),
        )
    ]
    assert words == ["confirmed", "not measured", "not measured", "not measured", "confirmed", "confirmed"]
    # 16 small blocks beside three of 16 cells each: 64² / (16 + 3 * 16²)
    mixed = replace(single, partition=Partition.of_blocks(finer, 0.5))
    assert weigh(frame.geometry[0], 1.0, mixed, outline_cell=0.25).cells == pytest.approx(5.224, abs=0.001)


def test_more_of_the_other_sign_does_not_confirm():
    assert verdict(Evidence(1.0, 100.0, 0.35, 0.40, 0.0)) == "not confirmed"
    assert verdict(Evidence(1.0, 100.0, 0.40, 0.35, 0.0)) == "confirmed"
    assert verdict(Evidence(1.0, 100.0, 0.20, 0.25, 0.0)) == "not confirmed"
    assert verdict(Evidence(1.0, 100.0, 0.25, 0.20, 0.0)) == "confirmed in part"


def test_a_datum_shift_measures_no_zone():
    frame = zones(("uplift", box(0, 0, 2, 2)))
    change = changed(np.full((8, 8), 0.3), np.ones((8, 8), bool), 0.5, uniform=0.3)
    assert list(confirm_zones(frame, change, outline_cell=0.25)["confirmed"]) == ["not measured"]


def test_no_zone_and_a_zone_elsewhere():
    change = changed(np.full((8, 8), 0.3), np.ones((8, 8), bool), 0.5)
    far = confirm_zones(zones(("uplift", box(100, 100, 2, 2))), change, outline_cell=0.25).iloc[0]
    assert far["confirmed"] == "not measured"
    assert far["compared_share"] == 0
    assert np.isnan(far["change_share"])
    empty = confirm_zones(zones(("uplift", box(0, 0, 2, 2))).iloc[:0], change, outline_cell=0.25)
    assert {"confirmed", "dz_signif_m"} <= set(empty.columns)
    assert not any("safe" in word for word in VERDICTS)

"""Zones against a flood fill and plain loops, and against shapes whose figures are known."""

from __future__ import annotations

from datetime import date

import numpy as np
import pytest
from pyproj import CRS
from scipy import ndimage
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.extraction import Zones, footprint_frame
from slopewatch.engine.zones.fields import FIELDS
from slopewatch.interface.parameters import ZoneParameters
from slopewatch.tests.builders.change_zones import blocks_of, zones_of

UTM = CRS("EPSG:32651")
EVERYTHING = ZoneParameters(minimum_area=0.0, minimum_cells=2, minimum_confidence=0.0)


def grid_of(shape: tuple[int, int], cell: float = 0.5) -> Grid:
    return Grid(west=500000.0, north=4000100.0, cell=cell, rows=shape[0], columns=shape[1])


def run(dz: np.ndarray, parameters: ZoneParameters = EVERYTHING, *, cell: float = 0.5, **options: object) -> Zones:
    """Zones of ``dz`` with a level of 0.1 m, a standard error of 0.05 m and three points in every cell."""
    lod = options.pop("lod", np.full(dz.shape, 0.1))
    sigma = options.pop("sigma", np.full(dz.shape, 0.05))
    count = options.pop("count", np.full(dz.shape, 3))
    significant = options.pop("significant", np.nan_to_num(np.abs(dz)) > lod)
    return zones_of(dz, significant, lod, sigma, count, grid_of(dz.shape, cell), UTM, parameters, **options)


def flood_fill(dz: np.ndarray, significant: np.ndarray) -> list[list[tuple[int, int]]]:
    """Groups of cells of one sign that touch by edge or corner, found one cell at a time."""
    left = {(int(i), int(j)) for i, j in np.argwhere(significant & np.isfinite(dz) & (dz != 0))}
    groups = []
    while left:
        group, stack = [], [left.pop()]
        while stack:
            i, j = stack.pop()
            group.append((i, j))
            for near in [(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]:
                if near in left and (dz[near] > 0) == (dz[i, j] > 0):
                    left.remove(near)
                    stack.append(near)
        groups.append(sorted(group))
    return groups


def test_figures_equal_plain_loops() -> None:
    random = np.random.default_rng(4)
    dz = ndimage.gaussian_filter(random.normal(size=(40, 60)), 2) * 2 + random.normal(size=(40, 60)) * 0.05
    dz[random.random(dz.shape) < 0.1] = np.nan
    lod = random.uniform(0.05, 0.2, dz.shape)
    sigma = np.hypot(random.uniform(0.01, 0.1, dz.shape), 0.02)
    count = random.integers(1, 30, dz.shape)
    heights = random.normal(size=dz.shape)
    significant = np.nan_to_num(np.abs(dz)) > lod
    parameters = ZoneParameters(
        minimum_area=1.5, minimum_cells=3, minimum_confidence=0.0, severity_moderate=0.2, severity_high=0.5
    )
    found = run(
        dz,
        parameters,
        lod=lod,
        sigma=sigma,
        count=count,
        significant=significant,
        heights=heights,
        registration_error=0.02,
        epochs=(date(2024, 1, 1), date(2024, 3, 1)),
        method="robust",
        run_id="r1",
    )
    groups = flood_fill(dz, significant)
    kept = [g for g in groups if len(g) >= 6]  # 1.5 m² of cells of 0.25 m²
    assert len(found.frame) == len(kept) > 5
    assert len(kept) < len(groups)
    for group in kept:
        label = found.labels[group[0]]
        assert sorted(map(tuple, np.argwhere(found.labels == label).tolist())) == group
        row = found.frame.iloc[label - 1]
        values = [dz[c] for c in group]
        area = 0.25 * len(group)
        sign = 1 if values[0] > 0 else -1
        p95 = sign * np.percentile(np.abs(values), 95)
        plane = np.array([[1.0, c[1] * 0.5, -c[0] * 0.5] for c in group])
        _, east, north = np.linalg.lstsq(plane, [heights[c] for c in group], rcond=None)[0]
        expected = {
            "area_m2": area,
            "n_cells": len(group),
            "dz_mean_m": np.mean(values),
            "dz_min_m": min(values),
            "dz_max_m": max(values),
            "dz_p95_m": p95,
            "lod95_m": np.median([lod[c] for c in group]),
            "n_pts_min": min(count[c] for c in group),
            "slope_deg": np.degrees(np.arctan(np.hypot(east, north))),
            "days": 60,
            "rate_mm_day": np.mean(values) * 1000 / 60,
        }
        assert {name: float(row[name]) for name in expected} == pytest.approx(expected, abs=1e-6)
        assert row["kind"] == ("uplift" if sign > 0 else "subsidence")
        grade = "high" if abs(p95) >= 0.5 else "moderate" if abs(p95) >= 0.2 else "low"
        assert row["severity"] == (grade if row["confidence"] >= 0.95 else "unsure")
        assert 0.0 <= row["confidence"] <= 1.0
        assert row.geometry.area == pytest.approx(area, rel=1e-9)
    assert set(found.frame["epoch_from"]) == {"2024-01-01"}
    assert set(found.frame["review_status"]) == {"unreviewed"}
    assert set(found.frame["n_epochs_confirmed"]) == {1}
    assert set(found.frame["method"]) == {"robust"}
    assert set(found.frame["run_id"]) == {"r1"}


def test_hole_is_kept_and_edges_are_the_cells_own() -> None:
    dz = np.zeros((12, 12))
    dz[2:9, 3:10] = -0.4
    dz[4:6, 5:8] = 0.0
    zone = run(dz).frame.geometry[0]
    assert zone.geom_type == "MultiPolygon"
    assert len(zone.geoms) == 1
    assert zone.bounds == pytest.approx((500001.5, 4000095.5, 500005.0, 4000099.0))
    (hole,) = zone.geoms[0].interiors
    assert hole.bounds == pytest.approx((500002.5, 4000097.0, 500004.0, 4000098.0))
    assert zone.area == pytest.approx((49 - 6) * 0.25)


def test_cells_that_meet_in_a_corner_are_one_valid_zone() -> None:
    dz = np.zeros((10, 10))
    dz[1:4, 1:4] = 0.3
    dz[4:7, 4:7] = 0.3
    frame = run(dz).frame
    assert len(frame) == 1
    assert len(frame.geometry[0].geoms) == 2
    assert frame.geometry[0].is_valid
    assert frame.geometry[0].area == pytest.approx(18 * 0.25)


def test_polygons_of_ragged_patterns_are_valid_and_cover_their_cells() -> None:
    for seed in range(25):
        random = np.random.default_rng(seed)
        dz = np.where(random.random((30, 30)) < random.uniform(0.3, 0.7), 0.2, 0.0) * random.choice((-1, 1), (30, 30))
        found = run(dz)
        assert found.frame.is_valid.all()
        assert found.frame.area.to_numpy() == pytest.approx(found.frame["n_cells"].to_numpy(float) * 0.25)
        assert np.bincount(found.labels.ravel())[1:].tolist() == found.frame["n_cells"].tolist()


def two_blocks(between: float, width: int) -> np.ndarray:
    """Two raised blocks of 4 x 4 cells with ``width`` columns of ``between`` from one to the other."""
    dz = np.zeros((8, 20))
    dz[2:6, 2:6] = dz[2:6, 6 + width : 10 + width] = 0.3
    dz[:, 6 : 6 + width] = between
    return dz


@pytest.mark.parametrize(
    ("between", "width", "gap", "zones"),
    [
        (np.nan, 2, 0.2, 1),
        (np.nan, 3, 0.2, 2),
        (np.nan, 3, 0.4, 1),
        (np.nan, 1, 0.0, 2),
        (0.0, 1, 0.4, 2),
        (-0.3, 1, 0.4, 3),
    ],
)
def test_only_gaps_without_data_are_bridged(between: float, width: int, gap: float, zones: int) -> None:
    parameters = ZoneParameters(minimum_area=0.0, minimum_cells=2, bridged_gap=gap)
    found = run(two_blocks(between, width), parameters, cell=0.1)
    assert len(found.frame) == zones
    raised = found.frame[found.frame["kind"] == "uplift"]
    assert raised["n_cells"].sum() == 32  # the gap does not count
    assert raised.area.sum() == pytest.approx(0.32)
    assert raised.is_valid.all()


def test_touching_cells_of_opposite_sign_are_two_zones() -> None:
    dz = np.full((6, 10), 0.2)
    dz[:, 5:] = -0.2
    frame = run(dz).frame
    assert sorted(frame["kind"]) == ["subsidence", "uplift"]
    assert frame.geometry[0].intersection(frame.geometry[1]).area == 0


def test_cells_without_data_or_significance_stay_out() -> None:
    dz = np.full((6, 6), 0.5)
    dz[0] = np.nan
    significant = np.ones(dz.shape, dtype=bool)
    significant[5] = False
    assert run(dz, significant=significant).frame["n_cells"].tolist() == [24]


def test_one_noisy_cell_is_no_zone_however_large() -> None:
    dz = np.zeros((5, 5))
    dz[2, 2] = 9.0
    assert len(run(dz, ZoneParameters(minimum_area=0.0), cell=10.0).frame) == 0
    dz[2, 3] = 9.0
    assert len(run(dz, ZoneParameters(minimum_area=0.0, minimum_cells=2), cell=10.0).frame) == 1


def test_change_that_shows_in_every_second_cell_is_as_large_as_what_it_covers() -> None:
    dz = np.full((30, 30), np.nan)
    dz[5:15, 5:15] = 0.2  # 1 m² of cells of 0.1 m
    row, column = np.indices(dz.shape)
    dz[(row + column) % 2 == 1] = np.nan
    assert np.isfinite(dz).sum() == 50
    whole = ZoneParameters(minimum_area=0.75, bridged_gap=0.2)
    assert run(dz, whole, cell=0.1).frame["n_cells"].tolist() == [50]
    assert len(run(dz, ZoneParameters(minimum_area=0.75, bridged_gap=0.0), cell=0.1).frame) == 0
    dz[np.isnan(dz)] = 0.0  # measured, and nothing has changed there: half of the cells is half of the area
    assert len(run(dz, whole, cell=0.1).frame) == 0


def test_zone_of_exactly_the_least_area_stays() -> None:
    dz = np.zeros((20, 20))
    dz[0:5, 0:10] = 0.2
    dz[10:17, 10:17] = 0.2  # 49 cells
    frame = run(dz, ZoneParameters(minimum_area=0.5), cell=0.1).frame
    assert frame["n_cells"].tolist() == [50]


def test_pure_noise_yields_no_zone() -> None:
    dz = np.random.default_rng(0).normal(size=(400, 400)) * 0.05
    found = run(dz, ZoneParameters(), cell=0.1, lod=np.full(dz.shape, 0.098))
    assert np.mean(np.abs(dz) > 0.098) == pytest.approx(0.05, rel=0.05)
    assert len(found.frame) == 0


def test_most_severe_first_then_by_volume() -> None:
    dz = np.zeros((20, 40))
    dz[1:9, 1:9] = 0.15  # moderate, the largest volume of its grade
    dz[12:15, 1:4] = -0.15  # moderate, small
    dz[1:4, 20:23] = -0.6  # high
    dz[10:19, 15:39] = 0.08  # low, large area
    lod = np.full(dz.shape, 0.05)
    options = {"lod": lod, "sigma": np.full(dz.shape, 0.01)}
    frame = run(dz, **options).frame
    assert frame["zone_id"].tolist() == ["Z001", "Z002", "Z003", "Z004"]
    assert frame["severity"].tolist() == ["high", "moderate", "moderate", "low"]
    assert frame["dz_mean_m"].tolist() == pytest.approx([-0.6, 0.15, -0.15, 0.08])
    again = run(dz, **options).frame
    assert frame.equals(again)


def test_the_columns_of_a_volume_agree() -> None:
    random = np.random.default_rng(5)
    dz = random.normal(0, 0.05, (60, 80))
    dz[10:20, 10:20] -= 0.5
    dz[30:45, 40:70] += 0.3
    found = run(dz, ZoneParameters(), registration_error=0.01, epochs=(date(2024, 1, 1), date(2024, 3, 1)))
    frame = found.frame
    assert frame["kind"].tolist() == ["uplift", "subsidence"]
    np.testing.assert_array_equal(frame["vol_net_m3"], frame["vol_gain_m3"] - frame["vol_loss_m3"])
    np.testing.assert_allclose(frame["vol_low_m3"], frame["vol_net_m3"] - 1.96 * frame["vol_err_m3"], atol=1e-3)
    np.testing.assert_allclose(frame["vol_high_m3"], frame["vol_net_m3"] + 1.96 * frame["vol_err_m3"], atol=1e-3)
    # what happened: 450 and 100 cells of 0.25 m²
    assert frame["vol_net_m3"].tolist() == pytest.approx([33.75, -12.5], rel=0.05)
    np.testing.assert_allclose(found.volumes.net, frame["vol_net_m3"], atol=1e-6)
    # nothing correlates: the mean of n cells errs by the registration and 1 / sqrt(n) of the rest
    own = np.sqrt(0.05**2 - 0.01**2) / np.sqrt(frame["n_cells"].to_numpy(float))
    np.testing.assert_allclose(frame["rate_err"], np.hypot(own, 0.01) * 1000 / 60, rtol=0.15)
    for row, footprint in zip(frame.itertuples(), found.footprints, strict=True):
        inside = np.zeros(dz.shape, dtype=bool)
        inside[footprint.window] = footprint.inside
        assert inside[found.labels == row.Index + 1].all()
        assert row.vol_area_m2 == pytest.approx(inside.sum() * 0.25)
        assert row.vol_net_m3 == pytest.approx(dz[inside].sum() * 0.25, abs=1e-6)
        assert row.vol_measured == 1.0
    outlines = footprint_frame(found, grid_of(dz.shape))
    assert outlines["zone_id"].tolist() == ["Z001", "Z002"]
    assert outlines.area.tolist() == pytest.approx(frame["vol_area_m2"].tolist())
    assert all(outlines.geometry.covers(frame.geometry))


def test_inclination_of_a_plane() -> None:
    dz = np.full((10, 14), 0.3)
    rows, columns = np.indices(dz.shape)
    heights = 900.0 + np.tan(np.radians(39.0)) * 0.5 * (0.6 * columns + 0.8 * rows)
    heights[0, :5] = np.nan
    assert run(dz, heights=heights).frame["slope_deg"][0] == pytest.approx(39.0, abs=1e-6)
    line = np.zeros((10, 14))
    line[4, 2:10] = 0.3
    assert np.isnan(run(line, heights=heights).frame["slope_deg"][0])


def test_without_dates_there_are_no_rates() -> None:
    row = run(np.full((4, 4), 0.3)).frame.iloc[0]
    assert row["epoch_from"] == row["epoch_to"] == ""
    for field in ("days", "rate_mm_day", "rate_err", "slope_deg", "chain_from", "chain_to"):
        assert row[[field]].isna().all()


def test_no_zone_still_has_every_field() -> None:
    none, some = run(np.zeros((4, 4))).frame, run(np.full((4, 4), 0.3)).frame
    assert len(none) == 0
    assert list(none.columns) == [*FIELDS, "geometry"]
    assert none.dtypes.equals(some.dtypes)
    assert none.crs == UTM
    assert all(name == name.lower() and len(name) <= 31 for name in FIELDS)


def test_zones_are_in_the_horizontal_part_of_a_compound_system() -> None:
    dz = np.full((4, 4), 0.3)
    args = dz, dz > 0, dz, dz, np.ones(dz.shape, int), grid_of(dz.shape)
    assert zones_of(*args, CRS("EPSG:32651+5773"), EVERYTHING).frame.crs == UTM
    assert zones_of(*args, None, EVERYTHING).frame.crs is None


def grown_blocks() -> tuple[np.ndarray, np.ndarray]:
    """A change in blocks of 4 by 4 cells (and some single cells), every cell of a block the same."""
    random = np.random.default_rng(8)
    block = np.arange(60).reshape(6, 10).repeat(4, axis=0).repeat(4, axis=1)
    values = ndimage.gaussian_filter(random.normal(size=(6, 10)), 1) * 3
    dz = values.repeat(4, axis=0).repeat(4, axis=1)
    fine = random.random(block.shape) < 0.2
    block[fine] = 60 + np.arange(fine.sum())
    dz[fine] += random.normal(0, 0.02, fine.sum())
    return dz, block


def test_a_grown_block_counts_as_one_cell() -> None:
    dz, block = grown_blocks()
    dz[:, 20:] = np.nan
    dz[4:8, 12:16], block[4:8, 12:16] = 5.0, 7
    around = np.s_[3:9, 11:17]
    dz[around] = np.where(np.abs(dz[around]) < 5, 0.0, dz[around])  # one block stands alone
    parameters = ZoneParameters(minimum_area=0.0, minimum_cells=2)
    assert run(dz, parameters).labels[5, 13] > 0
    side = np.where(block < 60, 2.0, 0.5)
    found = run(dz, parameters, partition=blocks_of(block, 0.5, side))
    assert found.labels[5, 13] == 0
    for zone in range(1, len(found.frame) + 1):
        blocks = set(block[found.labels == zone].tolist())
        assert found.frame["n_cells"].iloc[zone - 1] == len(blocks) >= 2
        # of each block, the part of its square of 16 cells that is in the zone
        parts = [np.sum((block == b) & (found.labels == zone)) / (16 if b < 60 else 1) for b in blocks]
        assert sum(parts) >= 2 - 1e-9
        assert found.frame["area_m2"].iloc[zone - 1] == pytest.approx(np.sum(found.labels == zone) * 0.25)

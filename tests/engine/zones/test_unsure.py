"""Change beyond its level that is no zone: a faint wide one is sure by a disc, the rest stands in a layer with why."""

from __future__ import annotations

import math
from pathlib import Path

import geopandas as gpd
import numpy as np
import pytest
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.zones.extraction import Zones, footprint_frame
from slopewatch.engine.zones.fields import REASONS, UNSURE_FIELDS
from slopewatch.tests.builders.change_zones import zones_of
from slopewatch.workflows.products.zones import write_zones

SHAPE, CELL, ERROR = (80, 80), 1.0, 0.05
GRID = Grid(0.0, 0.0, CELL, *SHAPE)
ROW, COLUMN = np.indices(SHAPE)
INSIDE = np.hypot(ROW - 40, COLUMN - 40) <= 10


def found(dz: np.ndarray, *, error: float = ERROR, **more: np.ndarray) -> Zones:
    errors = np.full(SHAPE, error)
    explained = more.get("plant_like", np.zeros(SHAPE, dtype=bool))
    significant = (np.abs(dz) > 1.96 * error) & ~explained
    return zones_of(dz, significant, 1.96 * errors, errors, np.full(SHAPE, 9), GRID, **more)


def noise(seed: int) -> np.ndarray:
    return ERROR * np.random.default_rng(seed).standard_normal(SHAPE)


def reasons(zones: Zones) -> list[str]:
    return zones.unsure["reason"].tolist()


def test_a_group_in_wide_faint_change_is_a_zone_and_the_same_group_in_noise_is_none() -> None:
    group = (ROW == 40) & (abs(COLUMN - 40) <= 3)
    still = np.clip(noise(1), -1.8 * ERROR, 1.8 * ERROR)
    for around, expected in ((1.4 * ERROR, 1), (0.0, 0)):
        dz = np.where(group, 2.1 * ERROR, np.where(INSIDE, around + 0.3 * still, still))
        zones = found(dz)
        assert len(zones.frame) == expected
        assert len(zones.unsure) == 1 - expected
    assert reasons(zones) == ["chance"]


def test_what_is_no_zone_has_its_mean_its_error_and_the_reason() -> None:
    dz = noise(5)
    np.clip(dz, -1.8 * ERROR, 1.8 * ERROR, out=dz)
    dz[10, 10:15] = [0.11, 0.12, 0.1, 0.11, 0.12]  # 2.2 errors: may be chance
    dz[60, 60:62] = -0.6  # sure, and two cells are too few
    dz[40:45, 20:25], plants = 0.2, np.zeros(SHAPE)
    plants[40:45, 20:25] = 0.1  # two errors by plants
    explained = np.zeros(SHAPE, dtype=bool)
    dz[20:25, 50:55], explained[20:25, 50:55] = -0.3, True
    zones = found(dz, plants=plants, plant_like=explained, explained=explained)
    assert zones.frame.empty
    told = zones.unsure.set_index("reason")
    assert sorted(told.index) == sorted(REASONS)
    assert told.loc["chance", "dz_mean_m"] == pytest.approx(0.112)
    assert told.loc["chance", "area_m2"] == 5.0
    # independent cells: what the variogram of stable ground says of five of them
    assert told.loc["chance", "dz_err_m"] == pytest.approx(ERROR / math.sqrt(5), rel=0.25)
    assert told.loc["small", ["kind", "n_cells"]].tolist() == ["subsidence", 2]
    assert told.loc["vegetation", "dz_err_m"] >= 0.1, "the error by plants is one for all cells"
    assert told.loc["season", "dz_mean_m"] == pytest.approx(-0.3)


def test_the_layer_is_in_the_file_of_zones_and_in_no_sum(tmp_path: Path) -> None:
    dz = np.clip(noise(6), -1.8 * ERROR, 1.8 * ERROR)
    dz[10, 10:15] = 0.11
    zones = found(dz)
    assert reasons(zones) == ["chance"]
    assert zones.volumes.total == (0.0, 0.0)
    path = tmp_path / "zones.gpkg"
    write_zones(path, zones.frame, footprints=footprint_frame(zones, GRID), unsure=zones.unsure)
    read = gpd.read_file(path, layer="unsure")
    assert list(read.columns.drop("geometry")) == list(UNSURE_FIELDS)
    assert read.geometry.area.tolist() == [5.0]
    assert gpd.read_file(path, layer="zones").empty

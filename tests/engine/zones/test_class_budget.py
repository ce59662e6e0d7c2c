"""Change by class of asset, against sums over the pixels and against the volume table of the whole."""

from __future__ import annotations

import math
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS
from scipy.ndimage import gaussian_filter
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.vector.asset_classes import AssetClasses, read_asset_classes
from slopewatch.engine.zones.class_budget import NO_CLASS, WHOLE, class_budgets
from slopewatch.engine.zones.footprints import Cells
from slopewatch.engine.zones.gcd_table import volume_table
from slopewatch.engine.zones.volumes import CorrelationModel, ZoneVolumes, fit_correlation

UTM = CRS.from_epsg(32651)
GRID = Grid(500_000.0, 2_500_020.0, 0.5, 40, 60)
CORRELATED = CorrelationModel(0.004, None)


def polygons(path: Path, shapes: dict[str, list[tuple[float, float, float, float]]], field: str = "class") -> Path:
    """Boxes (west, south, east, north in metres from the grid's south-west corner) by their class."""
    rows = [(name, shapely.box(*b)) for name, boxes in shapes.items() for b in boxes]
    moved = [shapely.transform(box, lambda xy: xy + (500_000.0, 2_500_000.0)) for _, box in rows]
    geopandas.GeoDataFrame({field: [name for name, _ in rows]}, geometry=moved, crs=UTM).to_file(path)
    return path


def classes(tmp_path: Path, **shapes: list[tuple[float, float, float, float]]) -> AssetClasses:
    return read_asset_classes(polygons(tmp_path / "classes.gpkg", shapes), "class", UTM)[0]


def field(seed: int = 3, area: float = 0.25) -> tuple[Cells, np.ndarray]:
    rng = np.random.default_rng(seed)
    dz = rng.normal(0.0, 0.1, GRID.shape)
    dz[rng.random(GRID.shape) < 0.2] = np.nan
    dz[3:6, 5:20] = -0.8
    error = np.where(np.isfinite(dz), rng.uniform(0.02, 0.06, GRID.shape), np.nan)
    cells = Cells(dz, error, np.full(GRID.shape, area), Partition(GRID.shape, GRID.cell))
    return cells, np.abs(np.nan_to_num(dz)) > 1.96 * np.nan_to_num(error, nan=np.inf)


BENCH = [(0.0, 5.0, 12.3, 19.0), (20.0, 5.0, 25.0, 9.9)]
DRAIN = [(12.3, 5.0, 14.0, 19.0)]


def test_every_row_is_the_sum_over_its_pixels(tmp_path: Path) -> None:
    """One by one: a pixel counts in the class that holds its centre."""
    found = classes(tmp_path, bench=BENCH, drain=DRAIN)
    cells, significant = field()
    areas = [(n, s.area) for n, s in zip(found.names, found.shapes, strict=True)]
    rows = {r.name: r for r in class_budgets(cells, significant, found.labels(GRID), areas, CORRELATED)}
    assert list(rows) == ["bench", "drain", NO_CLASS, WHOLE]
    sums = {
        name: dict.fromkeys(("compared", "down", "up", "down_area", "net", "down_error", "net_error"), 0.0)
        for name in rows
    }
    for row in range(GRID.rows):
        for column in range(GRID.columns):
            x, y = (column + 0.5) * 0.5, 20.0 - (row + 0.5) * 0.5
            own = next(
                (
                    n
                    for n, boxes in (("bench", BENCH), ("drain", DRAIN))
                    if any(w < x < e and s < y < h for w, s, e, h in boxes)
                ),
                NO_CLASS,
            )
            dz, error = cells.dz[row, column], cells.error[row, column]
            if math.isnan(dz):
                continue
            for name in (own, WHOLE):
                into = sums[name]
                into["compared"] += 0.25
                into["net"] += 0.25 * dz
                # fully correlated sampling errors add up
                sampling = math.sqrt(max(error**2 - 0.004**2, 0.0))
                into["net_error"] += 0.25 * sampling
                if significant[row, column] and dz < 0:
                    into["down"] += -0.25 * dz
                    into["down_area"] += 0.25
                    into["down_error"] += 0.25 * sampling
                elif significant[row, column]:
                    into["up"] += 0.25 * dz
    for name, expected in sums.items():
        got = rows[name]
        for value, key in (
            (got.compared_area, "compared"), (got.lowering, "down"), (got.raising, "up"), (got.all_net, "net"),
            (got.lowering_area, "down_area"),
        ):  # fmt: skip
            assert value == pytest.approx(expected[key], rel=1e-12, abs=1e-12), (name, key)
        assert got.net == pytest.approx(expected["up"] - expected["down"], abs=1e-11)
        assert got.mean == pytest.approx(expected["net"] / expected["compared"])
        registered = math.hypot(expected["down_error"], 0.004 * expected["down_area"])
        assert got.lowering_error == pytest.approx(registered, rel=1e-9)
        assert got.all_net_error == pytest.approx(
            math.hypot(expected["net_error"], 0.004 * expected["compared"]), rel=1e-9
        )
    assert rows["bench"].lowering_area > 0
    assert rows["bench"].compared_share == pytest.approx(rows["bench"].compared_area / found.shapes[0].area, rel=1e-9)
    assert rows[WHOLE].share == 1.0


def test_the_parts_are_the_whole_to_the_last_digits(tmp_path: Path) -> None:
    found = classes(tmp_path, bench=BENCH, drain=DRAIN, wall=[(0.0, 0.0, 30.0, 2.0)])
    cells, significant = field(5, area=0.25 / math.cos(math.radians(37)))
    named = [(n, s.area) for n, s in zip(found.names, found.shapes, strict=True)]
    *parts, whole = class_budgets(cells, significant, found.labels(GRID), named, CORRELATED)
    for name in (
        "compared_area", "lowering_area", "raising_area", "lowering", "raising", "net", "all_net", "share",
    ):  # fmt: skip
        total = math.fsum(getattr(p, name) for p in parts)
        assert total == pytest.approx(getattr(whole, name), rel=1e-14, abs=1e-13), name
    nothing = ZoneVolumes(*(np.zeros(0) for _ in range(6)), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    table = volume_table(cells, significant, nothing, CORRELATED)
    assert whole.compared_area == pytest.approx(table.area, rel=1e-12)
    assert (whole.lowering, whole.raising) == pytest.approx((table.thresholded.lowering, table.thresholded.raising))
    assert whole.all_net == pytest.approx(table.raw.net, abs=1e-9)
    assert whole.all_net_error == pytest.approx(table.raw_net_error, rel=1e-12), "as the table of volumes has it"


def test_errors_hold_the_scatter_of_simulated_surveys(tmp_path: Path) -> None:
    """Nothing moved; noise alike over two metres, and a shift: the net volume scatters by its error."""
    labels = classes(tmp_path, bench=[(2.0, 2.0, 12.0, 12.0)]).labels(GRID)
    rng = np.random.default_rng(11)
    sigma, shift = 0.03, 0.006
    noise = np.array([gaussian_filter(rng.normal(size=GRID.shape), 2.0, mode="wrap") for _ in range(150)])
    noise *= sigma / noise.std()
    noise += rng.normal(0.0, shift, (150, 1, 1))
    everywhere, nowhere = np.ones(GRID.shape, dtype=bool), np.zeros(GRID.shape, dtype=bool)
    scores = []
    for dz in noise:
        error = np.full(GRID.shape, math.hypot(sigma, shift))
        cells = Cells(dz, error, np.full(GRID.shape, 0.25), Partition(GRID.shape, GRID.cell))
        model = fit_correlation(cells, everywhere, shift)
        assert model.variogram is not None
        row = class_budgets(cells, nowhere, labels, [("bench", 100.0)], model)[0]
        scores.append(row.all_net / row.all_net_error)
        assert (row.lowering, row.lowering_error, row.share) == (0.0, 0.0, None)
    assert 0.8 < np.std(scores) < 1.25


def test_overlaps_are_refused_and_slivers_are_not(tmp_path: Path) -> None:
    sliver = classes(tmp_path, bench=[(0.0, 0.0, 10.1, 10.0)], drain=[(10.0, 0.0, 20.0, 10.0)])
    labels = sliver.labels(GRID)
    assert (labels == 1).sum() == (labels == 2).sum() == 400, "no cell's centre lies in both"
    both = classes(tmp_path, bench=[(0.0, 0.0, 10.5, 10.0)], drain=[(10.0, 0.0, 20.0, 10.0)])
    with pytest.raises(
        InputError, match=r"bench and drain of '.*' overlap on 5\.00 m², as at x 500010\.2, y 2500009\.8"
    ):
        both.labels(GRID)
    with pytest.raises(InputError, match=r"bench and drain of '.*' overlap on 30\.00 m², as at"):
        classes(tmp_path, bench=[(0.0, 0.0, 13.0, 10.0)], drain=[(10.0, 0.0, 20.0, 10.0)])
    far = classes(tmp_path, bench=[(100.0, 0.0, 110.0, 10.0)])
    with pytest.raises(InputError, match="lies on the slope; check their reference system"):
        far.labels(GRID)
    same = classes(tmp_path, bench=[(0.0, 0.0, 10.0, 10.0), (5.0, 0.0, 15.0, 10.0)])
    assert (same.labels(GRID) == 1).sum() == 600, "polygons of one class may overlap"
    assert same.shapes[0].area == pytest.approx(150.0)


def test_what_is_no_layer_of_classes_is_named(tmp_path: Path) -> None:
    path = polygons(tmp_path / "c.gpkg", {"bench": BENCH}, "kind")
    with pytest.raises(InputError, match="have no field class; name the one to take by --class-field"):
        read_asset_classes(path, "class", UTM)
    assert read_asset_classes(path, "KIND", UTM)[0].names == ("bench",)
    with pytest.raises(InputError, match=r"Polygon 1 of the classes .* has no class; give it its class"):
        read_asset_classes(polygons(tmp_path / "n.gpkg", {" ": BENCH}), "class", UTM)
    many = {f"c{i}": [(2.0 * i, 0.0, 2.0 * i + 1.0, 1.0)] for i in range(1001)}
    with pytest.raises(InputError, match="has 1001 values"):
        read_asset_classes(polygons(tmp_path / "m.gpkg", many), "class", UTM)


def test_a_class_in_another_reference_system(tmp_path: Path) -> None:
    path = polygons(tmp_path / "c.gpkg", {"bench": BENCH})
    geopandas.read_file(path).to_crs(4326).to_file(tmp_path / "d.gpkg")
    found, notes = read_asset_classes(tmp_path / "d.gpkg", "class", UTM)
    assert found.shapes[0].area == pytest.approx(12.3 * 14 + 5 * 4.9, rel=1e-5)
    assert any("was transformed" in note for note in notes)

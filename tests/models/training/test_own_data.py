"""Labels from dimensions and polygons, against clouds whose labels are known by construction."""

from __future__ import annotations

from pathlib import Path

import geopandas
import numpy as np
import pytest
from pyproj import CRS
from shapely import Point, Polygon, box
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.interface.parameters import FineTuneParameters, InputParameters
from slopewatch.models.preparation.prepare import UNKNOWN
from slopewatch.models.training.own_data import class_mapping, labels_of_values, read_own_clouds, slope_facts

UTM = CRS.from_epsg(32651)


def slope(seed: int = 1, points: int = 4000) -> np.ndarray:
    """(n, 3) a 40 degree slope of 20 by 20 m in plan."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 20, (points, 2))
    xyz = np.column_stack([xy + (400_000, 3_500_000), xy[:, 1] * np.tan(np.radians(40)) + rng.normal(0, 0.02, points)])
    return np.round(xyz, 3)


def cloud(path: Path, crs: CRS = UTM, factor: float = 1.0, seed: int = 1, **dimensions: np.ndarray) -> Path:
    xyz = slope(seed) / factor
    write_cloud(path, PointCloud(xyz=xyz, crs=crs, path=path), dimensions=dimensions)
    return path


def read(*paths: Path, polygons: Path | None = None, progress: Progress | None = None, **values):
    return read_own_clouds(paths, FineTuneParameters(**values), InputParameters(), polygons, progress or Progress())


def halves(seed: int = 1) -> np.ndarray:
    """0 in the west, 1 in the middle, 2 in the east."""
    return np.minimum((slope(seed)[:, 0] - 400_000) // 7, 2).astype(np.uint8)


def test_labels_come_from_the_dimension(tmp_path):
    labels = halves()
    labels[:10] = UNKNOWN
    path = cloud(tmp_path / "a.laz", slopewatch_class=labels)
    (found,) = read(path)
    np.testing.assert_array_equal(found.labels, labels)
    np.testing.assert_allclose(found.xyz, slope(), atol=6e-4)
    assert found.counts == {
        "background": (labels == 0).sum(), "uplift": (labels == 1).sum(), "subsidence": (labels == 2).sum(),
        "unknown": 10,
    }  # fmt: skip
    # 4,000 points on 400 m² in plan are 10 a m² there, cos(40°) times that on the slope.
    assert found.density == pytest.approx(10 * np.cos(np.radians(40)), rel=0.15)


def test_a_mapping_says_what_other_values_mean(tmp_path):
    values = np.array([2, 20, 21, 7, 2], dtype=np.float32)[np.arange(4000) % 5]
    values[0] = np.nan
    path = cloud(tmp_path / "a.laz", scalar=values)
    (found,) = read(path, dimension="Scalar", classes="2:background, 20:Uplift,21.0:subsidence,*:unknown")
    expected = np.array([0, 1, 2, UNKNOWN, 0])[np.arange(4000) % 5]
    expected[0] = UNKNOWN
    np.testing.assert_array_equal(found.labels, expected)


@pytest.mark.parametrize("text", ["2", "2:", ":uplift", "2:heave", "2:uplift,,", "2:uplift,2.0:background"])
def test_a_mapping_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="classes"):
        class_mapping(text)


def test_values_that_are_no_class_are_named(tmp_path):
    path = cloud(tmp_path / "a.laz", slopewatch_class=np.arange(4000, dtype=np.uint16) % 6)
    with pytest.raises(
        InputError, match=r"slopewatch_class of .*a\.laz' has values that are no class \(3, 4, 5\).*--cla"
    ):
        read(path)
    with pytest.raises(InputError, match=r"no class \(0\.5\)"):
        labels_of_values(np.array([0.0, 0.5]), class_mapping(""), "a.laz", "d")


def test_clouds_that_cannot_be_trained_on_are_refused(tmp_path):
    good = cloud(tmp_path / "good.laz", slopewatch_class=halves())
    plain = cloud(tmp_path / "plain.laz", seed=2)
    with pytest.raises(InputError, match=r"plain\.laz' has no dimension slopewatch_class; give one of classification"):
        read(good, plain)
    with pytest.raises(
        InputError, match=r"Classification are not SlopeWatch's classes; say what they are with --classes"
    ):
        read(plain, dimension="Classification")
    empty = cloud(tmp_path / "empty.laz", seed=3, slopewatch_class=np.full(4000, UNKNOWN, dtype=np.uint8))
    with pytest.raises(InputError, match=r"empty\.laz' has no labelled point; label some"):
        read(good, empty)
    flat = cloud(tmp_path / "one.laz", seed=4, slopewatch_class=np.ones(4000, dtype=np.uint8))
    with pytest.raises(InputError, match="All labelled points are uplift, and there is nothing to distinguish"):
        read(flat)
    (tmp_path / "copy.laz").write_bytes(good.read_bytes())
    with pytest.raises(InputError, match=r"good\.laz' and .*copy\.laz' are the same cloud"):
        read(good, tmp_path / "copy.laz")
    with pytest.raises(InputError, match=r"no\.laz' does not exist"):
        read(tmp_path / "no.laz")
    degrees = cloud(tmp_path / "degrees.laz", crs=CRS.from_epsg(4326), seed=5, slopewatch_class=halves(5))
    with pytest.raises(InputError, match="geographic"):
        read(degrees)


def test_a_class_without_points_is_said(tmp_path):
    progress = Progress()
    read(cloud(tmp_path / "a.laz", slopewatch_class=(halves() > 0).astype(np.uint8)), progress=progress)
    assert [w for w in progress.warnings if "labelled subsidence" in w]


def layer(path: Path, rows: list, crs: CRS | None = UTM, field: str = "class") -> Path:
    geopandas.GeoDataFrame({field: [r[0] for r in rows]}, geometry=[r[1] for r in rows], crs=crs).to_file(path)
    return path


def square(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return box(400_000 + x0, 3_500_000 + y0, 400_000 + x1, 3_500_000 + y1)


def test_polygons_give_the_points_inside_their_class(tmp_path):
    hole = square(2, 2, 8, 8).difference(square(4, 4, 6, 6))
    rows = [("uplift", hole), ("Subsidence", square(10, 10, 15, 15)), ("uplift", square(14, 14, 18, 18))]
    polygons = layer(tmp_path / "p.gpkg", rows)
    path = cloud(tmp_path / "a.laz")
    x, y = (slope()[:, k] - origin for k, origin in ((0, 400_000), (1, 3_500_000)))
    first = (x > 2) & (x < 8) & (y > 2) & (y < 8) & ~((x > 4) & (x < 6) & (y > 4) & (y < 6))
    second = (x > 10) & (x < 15) & (y > 10) & (y < 15)
    third = (x > 14) & (x < 18) & (y > 14) & (y < 18)
    expected = np.where(first | third, 1, np.where(second, 2, 0))
    expected[second & third] = UNKNOWN
    progress = Progress()
    (found,) = read(path, polygons=polygons, progress=progress)
    sure = np.abs(np.stack([x, y])[:, None] - np.array([2, 4, 6, 8, 10, 14, 15, 18])[:, None]).min(axis=(0, 1)) > 1e-3
    np.testing.assert_array_equal(found.labels[sure], expected[sure])
    assert [w for w in progress.warnings if f"{(second & third).sum()} points of" in w]
    (partly,) = read(path, polygons=polygons, outside="unknown")
    np.testing.assert_array_equal(partly.labels[sure], np.where(expected == 0, UNKNOWN, expected)[sure])


def test_polygons_in_another_system_and_a_cloud_in_feet(tmp_path):
    plan = square(2, 2, 12, 18)
    feet = CRS.from_proj4("+proj=utm +zone=51 +datum=WGS84 +units=ft")
    labels = []
    for name, path in (("m", cloud(tmp_path / "m.laz")), ("ft", cloud(tmp_path / "ft.laz", feet, 0.3048, seed=1))):
        moved = geopandas.GeoSeries([plan], crs=UTM).to_crs(4326)
        file = layer(tmp_path / f"{name}.geojson", [(21, moved[0])], crs=CRS.from_epsg(4326), field="code")
        (found,) = read(path, polygons=file, class_field="Code", classes="21:subsidence")
        labels.append(found.labels)
    x, y = (slope()[:, k] - origin for k, origin in ((0, 400_000), (1, 3_500_000)))
    inside = (x > 2.01) & (x < 11.99) & (y > 2.01) & (y < 17.99)
    outside = (x < 1.99) | (x > 12.01) | (y < 1.99) | (y > 18.01)
    for found in labels:
        assert (found[inside] == 2).all()
        assert (found[outside] == 0).all()


def test_polygons_that_cannot_be_used_are_refused(tmp_path):
    path = cloud(tmp_path / "a.laz")
    far = layer(tmp_path / "far.gpkg", [("uplift", square(500, 500, 510, 510))])
    with pytest.raises(InputError, match=r"No polygon of .*far\.gpkg' lies on any of the clouds"):
        read(path, polygons=far)
    with pytest.raises(InputError, match=r"far\.gpkg' have no field kind; .*--class-field \(there are class\)"):
        read(path, polygons=far, class_field="kind")
    strange = layer(tmp_path / "strange.gpkg", [("heave", square(1, 1, 5, 5))])
    with pytest.raises(InputError, match=r"strange\.gpkg' has the value 'heave' in the field class, which is no class"):
        read(path, polygons=strange)
    nothing = layer(tmp_path / "none.gpkg", [(None, square(1, 1, 5, 5)), ("uplift", square(6, 6, 8, 8))])
    with pytest.raises(InputError, match=r"none\.gpkg' has no value in the field class"):
        read(path, polygons=nothing)
    points = layer(tmp_path / "points.gpkg", [("uplift", Point(400_001, 3_500_001))])
    with pytest.raises(InputError, match=r"points\.gpkg' holds no polygons"):
        read(path, polygons=points)
    (tmp_path / "text.gpkg").write_text("no layer")
    with pytest.raises(InputError, match=r"text\.gpkg' cannot be read"):
        read(path, polygons=tmp_path / "text.gpkg")
    with pytest.raises(InputError, match=r"gone\.gpkg' do not exist"):
        read(path, polygons=tmp_path / "gone.gpkg")


def test_the_density_does_not_follow_from_the_extent():
    xyz = slope()
    gap = xyz[(xyz[:, 0] - 400_000) % 10 < 5]  # half of the slope is not covered
    assert slope_facts(gap).density == pytest.approx(slope_facts(xyz).density, rel=0.15)
    assert slope_facts(xyz[:20]) is None


def test_clouds_that_no_model_screens_are_warned_of(tmp_path):
    bare = cloud(tmp_path / "bare.laz", slopewatch_class=halves())
    xyz = slope()
    plants = np.concatenate([xyz, xyz + np.random.default_rng(2).uniform(0, 1.5, (4000, 1)) * (0, 0, 1)])
    roof = xyz.copy()
    roof[:, 2] = -np.abs(xyz[:, 1] - 3_500_010) * np.tan(np.radians(40))
    warned = []
    for name, points in (("plants", plants), ("roof", roof)):
        labels = np.resize(halves(), len(points))
        file = tmp_path / f"{name}.laz"
        write_cloud(file, PointCloud(xyz=points, crs=UTM, path=file), dimensions={"slopewatch_class": labels})
        progress = Progress()
        read(bare, file, progress=progress)
        warned.append(progress.warnings)
    assert len(warned[0]) == len(warned[1]) == 1
    assert "plants.laz' scatters as plants do" in warned[0][0]
    assert "roof.laz' has two opposite faces" in warned[1][0]

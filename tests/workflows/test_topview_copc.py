"""A COPC from above: the same rasters as of its LAZ, a region from the chunks near it, a quick view of its levels."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
import shapely
from geopandas import GeoDataFrame
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud import extent
from slopewatch.engine.pointcloud.copc import chosen_chunks
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.in_parts import CloudFile
from slopewatch.interface.parameters import InputParameters, RegionParameters, TopViewParameters
from slopewatch.tests.builders.copc_file import write_copc
from slopewatch.tests.workflows.test_topview import HEIGHT, SOUTH, WEST, WIDTH, write_slope
from slopewatch.workflows.products.topview import TOP_VIEW_OUTPUTS
from slopewatch.workflows.suggestroi import suggestroi_step
from slopewatch.workflows.topview import topview_step

Nodes = dict[tuple[int, int, int, int], int]
REGION = shapely.box(WEST + 4, SOUTH + 3, WEST + 9, SOUTH + 7)


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path, Nodes]:
    """A cloud as LAZ and as COPC, and the nodes of this with their points."""
    folder = tmp_path_factory.mktemp("copc")
    write_slope(folder / "slope.laz")
    return folder / "slope.laz", folder / "slope.copc.laz", write_copc(folder / "slope.laz", folder / "slope.copc.laz")


@pytest.fixture
def region(tmp_path) -> Path:
    GeoDataFrame(geometry=[REGION], crs=32651).to_file(tmp_path / "roi.gpkg")
    return tmp_path / "roi.gpkg"


@pytest.fixture
def read(monkeypatch) -> list[int]:
    """How many points each group had that was decompressed."""
    sizes: list[int] = []
    plain = extent.read_records

    def counted(*arguments, **options):
        for records in plain(*arguments, **options):
            sizes.append(len(records))
            yield records

    monkeypatch.setattr(extent, "read_records", counted)
    return sizes


def view(cloud: Path, folder: Path, roi: Path | None = None, *, crs: str = "", **given) -> tuple[dict, dict, list[str]]:
    """Bands by name, figures and warnings."""
    progress = Progress()
    done = topview_step(cloud, folder, TopViewParameters(**given), InputParameters(crs=crs), roi=roi, progress=progress)
    bands = {}
    for name in TOP_VIEW_OUTPUTS:
        if (folder / name).exists():
            with rasterio.open(folder / name) as raster:
                bands[name] = raster.read()
    return bands, done.figures, progress.warnings


def assert_equal(one: dict, other: dict) -> None:
    assert one.keys() == other.keys()
    for name, bands in one.items():
        np.testing.assert_array_equal(bands, other[name], err_msg=name)


def near_points(nodes: Nodes, cloud: Path, area: shapely.Polygon, levels: int | None = None) -> int:
    """Points of the nodes whose cubes touch an area, by the nodes' keys."""
    las = laspy.read(cloud)
    middle, side = (las.header.mins + las.header.maxs) / 2, float((las.header.maxs - las.header.mins).max()) + 0.002
    found = 0
    for (level, x, y, _), points in nodes.items():
        edge = side / 2**level
        corner = middle[:2] - side / 2 + edge * np.array([x, y])
        if (levels is None or level <= levels) and shapely.box(*corner, *(corner + edge)).intersects(area):
            found += points
    return found


def test_it_is_a_copc_to_another_program(files):
    laz, copc, nodes = files
    assert preflight(copc).copc
    with laspy.CopcReader.open(copc) as reader:
        every = reader.query()
        assert len(every) == sum(nodes.values()) == len(laspy.read(laz).points)
        assert len(reader.query(level=0)) == nodes[0, 0, 0, 0]
    assert len(nodes) > 50
    assert max(level for level, *_ in nodes) >= 3


def test_the_same_rasters_as_of_the_laz(files, tmp_path):
    """In the order of the COPC to the last bit; in another order but for the colours of equally high returns."""
    laz, copc, _ = files
    ordered = laspy.read(copc)
    ordered.header.vlrs = [vlr for vlr in ordered.header.vlrs if vlr.user_id != "copc"]
    ordered.evlrs = None
    ordered.write(tmp_path / "ordered.laz")
    assert not preflight(tmp_path / "ordered.laz").copc
    of_ordered, of_laz, of_copc = (view(path, tmp_path / path.stem) for path in (tmp_path / "ordered.laz", laz, copc))
    assert_equal(of_ordered[0], of_copc[0])
    assert of_laz[1] == of_ordered[1] == of_copc[1]
    assert len(of_laz[0]) == 5
    assert np.mean(of_laz[0].pop("top_view.tif") != of_copc[0].pop("top_view.tif")) < 0.002
    assert_equal(of_laz[0], of_copc[0])


def test_a_region_reads_the_chunks_that_touch_it_once(files, tmp_path, region, read):
    laz, copc, nodes = files
    of_laz = view(laz, tmp_path / "laz", region)
    assert sum(read) == preflight(laz).count  # decompressed once
    read.clear()
    of_copc = view(copc, tmp_path / "copc", region)
    assert sum(read) == near_points(nodes, laz, REGION) < 0.5 * preflight(copc).count
    assert_equal(of_laz[0], of_copc[0])
    assert of_laz[1] == of_copc[1]
    # what the header says of all points is not compared with some of them
    assert len(of_copc[2]) == len(of_laz[2]) == 1


def test_a_proposed_region_decompresses_once(files, tmp_path, read):
    laz, copc, _ = files
    found = []
    for path in (laz, copc):
        output = tmp_path / f"{path.stem}.gpkg"
        suggestroi_step(path, output, RegionParameters(), InputParameters(), progress=Progress())
        assert sum(read) == preflight(path).count
        read.clear()
        found.append(json.loads(output.with_name(f"{path.stem}_run.json").read_text())["metrics"])
    assert found[0] == found[1]


def test_a_disk_without_room_reads_again(files, tmp_path, read, monkeypatch):
    laz, _, _ = files
    wanted = view(laz, tmp_path / "once")
    read.clear()
    monkeypatch.setattr(
        "slopewatch.engine.pointcloud.kept_parts.shutil.disk_usage", lambda _: type("U", (), {"free": 9})
    )
    again = view(laz, tmp_path / "thrice")
    assert sum(read) == 3 * preflight(laz).count
    assert_equal(wanted[0], again[0])


@pytest.mark.parametrize("detail", [0.3, 1.0, 2.0, 50.0])
def test_levels_are_those_that_another_program_takes(files, tmp_path, read, detail):
    _, copc, nodes = files
    with laspy.CopcReader.open(copc) as reader:
        levels, step = 0, reader.copc_info.spacing
        while step > detail:
            levels, step = levels + 1, step / 2
        expected = len(reader.query(resolution=detail))
    wanted = sum(points for (level, *_), points in nodes.items() if level <= levels)
    assert wanted == expected
    bands, figures, warnings = view(copc, tmp_path / "out", detail=detail)
    if wanted > 0.8 * preflight(copc).count:
        assert sum(read) == preflight(copc).count
        assert "is read as a whole" in warnings[0]
        return
    assert sum(read) == wanted
    assert set(bands) == set(TOP_VIEW_OUTPUTS) - {"density.tif", "ground_density.tif"}
    assert "density" not in figures
    assert figures["points"] <= wanted
    assert figures["area_m2"] == pytest.approx(WIDTH * HEIGHT, rel=0.2)
    assert chosen_chunks(preflight(copc), None, detail).points == wanted


def test_densities_of_an_earlier_view_go(files, tmp_path):
    _, copc, _ = files
    view(copc, tmp_path / "out")
    assert (tmp_path / "out" / "density.qml").exists()
    settings = TopViewParameters(detail=2.0), InputParameters()
    topview_step(copc, tmp_path / "out", *settings, overwrite=True, progress=Progress())
    assert not list((tmp_path / "out").glob("*density*"))
    assert (tmp_path / "out" / "hillshade.tif").exists()


def test_levels_and_a_region_together(files):
    laz, copc, nodes = files
    cloud = replace(CloudFile.of(copc), near=REGION.bounds, spacing=1.0)
    assert cloud.chosen.points == near_points(nodes, laz, REGION, levels=2) == sum(len(p) for p in cloud.parts())


def test_detail_has_no_effect_on_a_laz(files, tmp_path):
    laz, _, _ = files
    plain, detailed = view(laz, tmp_path / "plain"), view(laz, tmp_path / "detail", detail=1.0)
    assert_equal(plain[0], detailed[0])
    assert any("it is no COPC" in sentence for sentence in detailed[2])


def test_a_real_copc(shared_data, tmp_path, read):
    copc = shared_data / "real" / "lone-star.copc.laz"
    area = shapely.box(515368.0, 4918340.0, 515378.0, 4918352.0)
    GeoDataFrame(geometry=[area], crs=32614).to_file(tmp_path / "roi.gpkg")
    las = laspy.read(copc)
    las.points = las.points[np.random.default_rng(0).permutation(len(las.points))]
    las.header.vlrs = [vlr for vlr in las.header.vlrs if vlr.user_id != "copc"]
    las.evlrs = None
    las.write(tmp_path / "plain.laz")
    read.clear()
    found = [
        view(path, tmp_path / path.stem, tmp_path / "roi.gpkg", crs="EPSG:32614", cell=0.2)
        for path in (copc, tmp_path / "plain.laz")
    ]
    assert sum(read) < 1.5 * preflight(copc).count
    for name in ("density.tif", "hillshade.tif", "canopy_height.tif", "ground_density.tif"):
        np.testing.assert_array_equal(found[0][0][name], found[1][0][name], err_msg=name)
    read.clear()
    quick = view(copc, tmp_path / "quick", crs="EPSG:32614", detail=0.5)
    assert 10_000 < sum(read) < 0.3 * preflight(copc).count
    full = view(copc, tmp_path / "all", crs="EPSG:32614", cell=quick[1]["cell_m"])
    assert quick[1]["area_m2"] == pytest.approx(full[1]["area_m2"], rel=0.05)

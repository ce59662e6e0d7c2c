"""A COPC is read by its bounds: fewer points, and the same within the bounds as of the whole file."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import shapely
from slopewatch.engine.ground import pdal_pipelines
from slopewatch.engine.ground.survey import Source, read_near
from slopewatch.engine.pointcloud.copc import chunks_near
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.reading import open_cloud, read_cloud
from slopewatch.engine.pointcloud.records import read_records
from slopewatch.engine.vector.area import Roi
from slopewatch.interface.parameters import InputParameters
from slopewatch.tests.builders.extracted_ground import any_pdal

INPUTS = InputParameters(crs="EPSG:32614")
CORNER = shapely.box(515368.0, 4918340.0, 515378.0, 4918352.0)
"""A region that holds a seventieth of the cloud."""


@pytest.fixture(scope="module")
def copc(shared_data) -> Path:
    return shared_data / "real" / "lone-star.copc.laz"


def near(path: Path, area: shapely.Polygon):
    return chunks_near(preflight(path), *np.array(area.bounds).reshape(2, 2))


def records_of(path: Path, **options) -> np.ndarray:
    return np.concatenate([records.array for records in read_records(preflight(path), **options)])


def inside(path: Path, records: np.ndarray, area: shapely.Polygon) -> np.ndarray:
    header = preflight(path)
    x, y = (records[f] * header.scales[k] + header.offsets[k] for k, f in enumerate("XY"))
    return records[shapely.contains_xy(area, x, y)]


def test_all_points_within_the_bounds_are_in_the_chunks_near_them(copc):
    found, every = near(copc, CORNER), records_of(copc)
    some = records_of(copc, starts=found.starts)
    assert len(some) == found.points < 0.5 * len(every)
    wanted = inside(copc, every, CORNER)
    assert 5_000 < len(wanted) < 0.2 * len(every)
    assert np.array_equal(inside(copc, some, CORNER), wanted)


@pytest.mark.parametrize("seed", range(5))
def test_any_small_box_gets_all_its_points(copc, seed):
    rng = np.random.default_rng(seed)
    header = preflight(copc)
    low, high = np.array(header.bounds_low[:2]), np.array(header.bounds_high[:2])
    corner = rng.uniform(low, high - 4)
    area = shapely.box(*corner, *(corner + rng.uniform(0.5, 4, 2)))
    found = near(copc, area)
    some = records_of(copc, starts=found.starts)
    assert found.points == len(some) < header.count
    assert np.array_equal(inside(copc, some, area), inside(copc, records_of(copc), area))


def test_pdal_clips_them_to_the_same_points(copc, tmp_path):
    header, frame = open_cloud(copc, INPUTS)
    source = Source(header, frame, Roi(CORNER, copc), 1000.0, False, False)
    chosen = read_near(source, tmp_path / "near.las")
    assert chosen.count < 0.5 * header.count
    for name, given in (("near", chosen), ("whole", header)):
        pipeline = pdal_pipelines.clip_pipeline(given.path, tmp_path / f"{name}_clip.las", given, frame, CORNER)
        any_pdal().run(pipeline, memory_limit=8_000_000_000)
    one, other = (records_of(tmp_path / f"{name}_clip.las") for name in ("near", "whole"))
    assert len(one) > 5_000
    assert np.array_equal(one, other)
    clouds = [read_cloud(tmp_path / f"{name}_clip.las") for name in ("near", "whole")]
    assert np.array_equal(clouds[0].xyz, clouds[1].xyz)


def test_a_cloud_that_is_read_as_a_whole(copc, tmp_path):
    header, frame = open_cloud(copc, INPUTS)
    everything = shapely.box(*header.bounds_low[:2], *header.bounds_high[:2])
    assert near(copc, everything) is None
    assert near(copc, shapely.box(0, 0, 1, 1)) is None
    for region in (None, Roi(everything, copc)):
        assert read_near(Source(header, frame, region, 1.0, False, False), tmp_path / "near.las") is header
    assert not (tmp_path / "near.las").exists()


def index_of(path: Path) -> tuple[int, int, int]:
    """Place of the record about the index, and where the index begins and how long it is."""
    header = preflight(path)
    raw = path.read_bytes()
    place = raw.index(header.vlrs[("copc", 1)])
    return place, *struct.unpack_from("<QQ", raw, place + 40)


@pytest.mark.parametrize(
    "damage",
    ["index beyond the file", "index of odd length", "negative key", "points missing", "page names itself", "no size"],
)
def test_a_damaged_index_is_not_followed(copc, tmp_path, damage):
    path = shutil.copyfile(copc, tmp_path / "damaged.copc.laz")
    place, offset, size = index_of(path)
    raw = bytearray(path.read_bytes())
    if damage == "index beyond the file":
        struct.pack_into("<Q", raw, place + 40, len(raw))
    elif damage == "index of odd length":
        struct.pack_into("<Q", raw, place + 48, size - 1)
    elif damage == "negative key":
        struct.pack_into("<i", raw, offset + 4, -3)
    elif damage == "points missing":
        struct.pack_into("<i", raw, offset + 28, struct.unpack_from("<i", raw, offset + 28)[0] - 1)
    elif damage == "page names itself":
        struct.pack_into("<Qii", raw, offset + 16, offset, size, -1)
    else:
        struct.pack_into("<d", raw, place + 24, 0.0)
    path.write_bytes(raw)
    assert near(path, CORNER) is None

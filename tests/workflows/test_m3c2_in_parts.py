"""M3C2 of clouds on the disk, box by box: the same files as of clouds in memory, within the memory that is allowed."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.m3c2.nearest import nearest_distances
from slopewatch.engine.m3c2.scales import spread_cores, survey_cores
from slopewatch.engine.m3c2.surveys import HeldSurvey, StoredSurvey, boxes, by_chance, pieces, whole
from slopewatch.engine.pointcloud import in_parts, point_squares
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.point_squares import Box
from slopewatch.interface.parameters import DistanceParameters, InputParameters, SurfaceParameters
from slopewatch.tests.builders.steep_pair import NORMAL, steep, write
from slopewatch.workflows import m3c2_clouds, pair
from slopewatch.workflows.m3c2 import m3c2_step
from slopewatch.workflows.settings import DistanceSettings

RASTERS = ("m3c2_distance", "m3c2_level_of_detection", "m3c2_significant")


@pytest.fixture
def on_disk(monkeypatch):
    """Any cloud stays on the disk, in small parts and squares, of which few points are in memory."""

    def begin(at_once: int = 3000) -> None:
        monkeypatch.setattr(pair, "MAX_HELD_POINTS", 0)
        monkeypatch.setattr(in_parts, "_PART_POINTS", 1300)
        monkeypatch.setattr(point_squares, "_MIN_SIDE_M", 0.5)
        monkeypatch.setattr(point_squares, "_SQUARE_POINTS", 40)
        monkeypatch.setattr(m3c2_clouds, "MOST_AT_ONCE", at_once)
        monkeypatch.setattr(m3c2_clouds, "FEWEST_AT_ONCE", min(at_once, 100))

    return begin


def m3c2(first: Path, second: Path, output: Path, *, ground: str = "auto", progress=None, **given):
    options = {name: given.pop(name, None) for name in ("raster_dir", "core", "transform_path", "roi", "stable")}
    settings = DistanceSettings(InputParameters(), DistanceParameters(**given), surface=SurfaceParameters(ground))
    progress = progress or Progress()
    return m3c2_step(first, second, output, settings, dates=(None, None), progress=progress, **options)


def both(first: Path, second: Path, folder: Path, on_disk, at_once: int = 3000, **given) -> tuple[Path, Path]:
    """Folders with the results of clouds in memory, and on the disk."""
    for name in ("held", "stored"):
        if name == "stored":
            on_disk(at_once)
        (folder / name).mkdir()
        m3c2(first, second, folder / name / "points.laz", **given)
    return folder / "held", folder / "stored"


def assert_equal(held: Path, stored: Path) -> None:
    for name in ("points.laz", *(f"{raster}.tif" for raster in RASTERS)):
        assert (held / name).read_bytes() == (stored / name).read_bytes(), name
    records = [json.loads((folder / "points_run.json").read_text()) for folder in (held, stored)]
    assert ["in_parts" in record["stages"][0] for record in records] == [False, True]
    for what in ("metrics", "scales", "level_of_detection", "warnings"):
        assert records[0][what] == records[1][what], what
    assert not list(stored.glob("**/*spool*"))


def with_plants(path: Path, seed: int, **shape) -> Path:
    """A face, part of it of class 1, with errors by plants; a gap, and a block far above."""
    xyz = steep(12_000, seed, **shape)
    rng = np.random.default_rng(seed)
    if seed == 2:
        xyz[(xyz[:, 0] - 5e5 > 9) & (np.abs(xyz[:, 1] - 3.5e6 - 4) < 1)] += 2.5 * NORMAL
    return write(path, xyz, plant_error=rng.uniform(0, 0.03, len(xyz)), plant_height=rng.uniform(0, 1, len(xyz)))


@pytest.fixture(scope="module")
def faces(tmp_path_factory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("faces")
    return (
        with_plants(folder / "slope_2024-05-01.laz", 1),
        with_plants(folder / "slope_2025-05-01.laz", 2, raised=0.3),
    )


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"calibrate": False, "normal_scale": 0.8},
        {"normals": "vertical", "half_length": 0.4},
        {"projection_scale": 0.5, "core_spacing": 0.31, "orientation": "0,-1,0"},
    ],
)
def test_the_same_bytes_as_in_one_piece(faces, tmp_path, on_disk, given):
    assert_equal(*both(*faces, tmp_path, on_disk, **given))


def test_given_cores_a_transform_and_ground_of_class_2(faces, tmp_path, on_disk):
    paths = []
    for number, path in enumerate(faces):
        las = laspy.read(path)
        las.classification[:: 7 + number] = 1
        paths.append(tmp_path / path.name)
        las.write(paths[-1])
    turn = RigidTransform(np.eye(3), np.array([0.02, -0.01, 0.015]), np.array([5e5, 3.5e6, 50.0]))
    turn.save(tmp_path / "transform.json", laspy.read(faces[0]).header.parse_crs())
    known = {"ground": "class_2", "transform_path": tmp_path / "transform.json"}
    assert_equal(*both(*paths, tmp_path, on_disk, **known))
    cores = laspy.read(tmp_path / "held" / "points.laz")
    assert set(np.asarray(cores.classification)) == {2}
    far = write(tmp_path / "cores.laz", np.vstack([steep(500, 9), [[5e5 + 90.0, 3.5e6, 50.0]]]))
    (tmp_path / "more").mkdir()
    folders = [tmp_path / "more" / name for name in ("held", "stored")]
    for folder in folders:
        folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pair, "MAX_HELD_POINTS", 6_000_000)
        m3c2(*paths, folders[0] / "points.laz", core=far, **known)
    m3c2(*paths, folders[1] / "points.laz", core=far, **known)
    assert_equal(*folders)


def test_adjoining_real_tiles(shared_data, tmp_path, on_disk):
    """Ground of two airborne tiles that touch, put together, and every other point of them as the later survey."""
    folder = shared_data / "real" / "ign_tiles"
    tiles = [laspy.read(folder / f"test_data_77050_{name}.laz") for name in ("627755_LA93_IGN69", "627760_LA93_IGN69")]
    xyz = np.vstack([np.asarray(las.xyz)[np.asarray(las.classification) == 2] for las in tiles])
    rng = np.random.default_rng(0)
    later = rng.random(len(xyz)) < 0.5
    paths = [
        write(tmp_path / f"tile_{year}-05-01.laz", xyz[chosen], crs=2154)
        for year, chosen in ((2024, ~later), (2025, later))
    ]
    held, stored = both(*paths, tmp_path, on_disk, at_once=8000)
    assert_equal(held, stored)
    assert len(laspy.read(stored / "points.laz").points) > 1000


def test_what_is_allowed_is_not_exceeded(faces, tmp_path, on_disk, monkeypatch):
    on_disk(4000)
    seen = []
    plain = StoredSurvey.within

    def within(self, box):
        found = plain(self, box)
        seen.append(len(found.xyz))
        return found

    monkeypatch.setattr(StoredSurvey, "within", within)
    m3c2(*faces, tmp_path / "points.laz")
    assert len(seen) > 20
    assert max(seen) <= 4000


class TestRefused:
    def test_too_little_memory_before_any_work(self, faces, tmp_path, monkeypatch):
        monkeypatch.setattr(m3c2_clouds, "read_cloud", None)
        monkeypatch.setattr(m3c2_clouds, "ground_on_disk", None)
        with pytest.raises(InputError, match=r"need at least 0\.39 GB, even in parts, and 0\.2 GB are allowed"):
            m3c2(*faces, tmp_path / "points.laz", memory_limit=0.2)
        assert not list(tmp_path.iterdir())

    def test_given_cores_that_do_not_fit(self, faces, tmp_path, on_disk, monkeypatch):
        on_disk()
        monkeypatch.setattr(m3c2_clouds, "CORE_BYTES", 1e5)
        with pytest.raises(InputError, match="The 12,000 core points of"):
            m3c2(*faces, tmp_path / "points.laz", memory_limit=0.46, core=faces[0])

    def test_a_given_spacing_with_too_many(self, faces, tmp_path, on_disk, monkeypatch):
        on_disk()
        monkeypatch.setattr(m3c2_clouds, "CORE_BYTES", 1e5)
        with pytest.raises(InputError, match="give a larger --core-spacing"):
            m3c2(*faces, tmp_path / "points.laz", memory_limit=0.46, core_spacing=0.2)

    def test_more_points_around_a_place_than_fit(self, faces, tmp_path, on_disk):
        on_disk(200)
        with pytest.raises(InputError, match="raise --memory-limit, give smaller scales"):
            m3c2(*faces, tmp_path / "points.laz", normal_scale=3.0)


def test_a_spacing_left_to_the_clouds_becomes_the_next_that_fits(faces, tmp_path, on_disk, monkeypatch):
    on_disk()
    monkeypatch.setattr(m3c2_clouds, "CORE_BYTES", 2e5)
    progress = Progress()
    done = m3c2(*faces, tmp_path / "points.laz", memory_limit=0.46, progress=progress)
    assert done.figures["core_points"] <= 500
    assert any("Core points every" in sentence for sentence in progress.warnings)


@pytest.fixture
def stored(faces, tmp_path, on_disk) -> tuple[HeldSurvey, StoredSurvey]:
    on_disk()
    cloud = in_parts.spool(faces[0], None, tmp_path / "0.points")
    held = HeldSurvey(np.concatenate([xyz for xyz, _ in cloud.parts()]))
    return held, StoredSurvey.of(cloud, 1500)


def test_boxes_hold_every_point_once(stored):
    held, on_file = stored
    numbers = np.concatenate([near.number for _, near in pieces(on_file)])
    assert np.array_equal(np.sort(numbers), np.arange(len(held)))
    assert sum(1 for _ in boxes([on_file], whole(on_file))) > 8
    box = Box(5e5 + 2.2, 3.5e6 + 1.1, 5e5 + 7.3, 3.5e6 + 4.4)
    one, other = held.within(box), on_file.within(box)
    assert 0 < len(one.number) < len(held)
    assert np.array_equal(one.number, other.number)
    assert np.array_equal(one.xyz, other.xyz)


def test_nearest_points_and_cores_are_those_of_the_whole(stored):
    held, on_file = stored
    rng = np.random.default_rng(0)
    places = held.xyz[rng.integers(0, len(held), 300)] + rng.normal(0, 2, (300, 3))
    for axes, number in ((2, 1), (3, 1), (3, 10)):
        want = np.sort(np.linalg.norm(places[:, None, :axes] - held.xyz[:, :axes], axis=2), axis=1)[:, number - 1]
        for survey in stored:
            assert np.allclose(nearest_distances(survey, places[:, :axes], number), want, rtol=0, atol=1e-9)
    bounds = (5e5 + 1, 3.5e6 + 1, 5e5 + 10, 3.5e6 + 6)
    for spacing in (0.3, 1.7):
        want = np.flatnonzero(spread_cores(held.xyz, spacing, bounds))
        assert np.array_equal(survey_cores(on_file, spacing, bounds)[1], want)
        assert np.array_equal(survey_cores(held, spacing, bounds)[1], want)


def test_a_share_by_chance_is_a_share():
    for share in (0.0, 0.1, 0.5, 1.0):
        taken = by_chance(np.arange(200_000), share)
        assert taken.mean() == pytest.approx(share, abs=0.005)
        assert taken[::2].mean() == pytest.approx(share, abs=0.007)


def test_points_on_the_disk_count_for_its_space(faces, tmp_path, on_disk, monkeypatch):
    on_disk()
    usage = type("Usage", (), {"free": preflight(faces[0]).count * 40})
    monkeypatch.setattr(in_parts.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(InputError, match="on the disk of"):
        m3c2(*faces, tmp_path / "points.laz")

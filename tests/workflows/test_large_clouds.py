"""What stays on the disk gives the same files as what is held in memory."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.geometry.rigid_transform import RigidTransform
from slopewatch.engine.maps import highest_points
from slopewatch.engine.pointcloud import in_parts
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.header import preflight
from slopewatch.engine.pointcloud.plant_cover import ERROR, HEIGHT
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.engine.registration import surveys
from slopewatch.interface.parameters import (
    ChangeParameters,
    LastEpochParameters,
    RegistrationParameters,
    SurfaceParameters,
    SurveyParameters,
)
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.tests.builders.turned_slope import turned_slope
from slopewatch.workflows import inspect, pair
from slopewatch.workflows.change import change_step
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.register import register_step
from slopewatch.workflows.settings import Settings

TURN = RigidTransform(
    np.array([[np.cos(1e-4), -np.sin(1e-4), 0.0], [np.sin(1e-4), np.cos(1e-4), 0.0], [0.0, 0.0, 1.0]]),
    np.array([0.03, -0.02, 0.01]),
    np.array([520.0, 915.0, 100.0]),
)
SETTINGS = Settings(change=ChangeParameters(cell=0.2))


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> dict[str, Path]:
    """Two surveys in colours, class 2 with some points of other classes, the later one displaced."""
    folder = tmp_path_factory.mktemp("large")
    found = {"transform": folder / "transform.json"}
    crs, rng = CRS.from_epsg(32651), np.random.default_rng(0)
    TURN.save(found["transform"], crs)
    for name, (xyz, cover) in zip(("first", "second"), turned_slope(30.0), strict=True):
        found[name] = folder / f"{name}.laz"
        cloud = PointCloud(
            xyz if name == "first" else TURN.inverse().apply(xyz),
            crs,
            found[name],
            rgb=rng.integers(0, 256, (len(xyz), 3)).astype(np.uint8),
            intensity=rng.integers(0, 5000, len(xyz)).astype(np.uint16),
            classification=np.where(rng.random(len(xyz)) < 0.1, 1, 2).astype(np.uint8),
        )
        write_cloud(found[name], cloud, dimensions={ERROR: cover.error.astype("f4"), HEIGHT: cover.height.astype("f4")})
    return found


@pytest.fixture
def on_disk(monkeypatch):
    """Any cloud is a large one, read in parts of a few thousand points."""

    def begin() -> None:
        monkeypatch.setattr(pair, "MAX_HELD_POINTS", 0)
        monkeypatch.setattr(inspect, "MAX_HELD_POINTS", 0)
        monkeypatch.setattr(inspect, "MAX_POINTS_AT_ONCE", 0)
        monkeypatch.setattr(in_parts, "_PART_POINTS", 1300)
        monkeypatch.setattr(highest_points, "_PART_POINTS", 2000)

    return begin


def contents(folder: Path) -> dict[str, bytes]:
    """Files by name; those that tell times, and the report of them, left out."""
    files = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: path.read_bytes() for name, path in files.items() if "run.json" not in name and "report" not in name}


def figures(folder: Path, name: str = "run.json") -> dict:
    return json.loads((folder / name).read_text())["metrics"]


@pytest.mark.parametrize("ground", ["auto", "class_2"])
def test_change_of_clouds_on_the_disk(files, tmp_path, on_disk, ground):
    settings = Settings(change=ChangeParameters(cell=0.2), surface=SurfaceParameters(ground=ground))

    def run(folder: Path) -> Progress:
        progress = Progress()
        change_step(
            files["first"], files["second"], folder, settings, dates=("2024-05-01", "2025-05-01"),
            transform_path=files["transform"], progress=progress,
        )  # fmt: skip
        return progress

    held = run(tmp_path / "held")
    on_disk()
    found = run(tmp_path / "disk")
    assert contents(tmp_path / "disk") == contents(tmp_path / "held")
    assert figures(tmp_path / "disk") == figures(tmp_path / "held")
    assert found.warnings == held.warnings
    assert "spool" not in [path.name for path in tmp_path.rglob("*")]


def test_cells_of_one_size_hold_their_points(files, tmp_path, on_disk):
    on_disk()
    settings = Settings(change=ChangeParameters(cell=0.5, adaptive=False))
    change_step(
        files["first"], files["second"], tmp_path / "out", settings, dates=("2024-05-01", "2025-05-01"),
        transform_path=files["transform"], progress=Progress(),
    )  # fmt: skip
    assert (tmp_path / "out" / "zones.gpkg").exists()


def test_no_point_of_class_2_on_the_disk(files, tmp_path, on_disk):
    on_disk()
    path = tmp_path / "plain.laz"
    xyz = turned_slope(10.0)[0][0]
    write_cloud(path, PointCloud(xyz, CRS.from_epsg(32651), path))
    settings = Settings(surface=SurfaceParameters(ground="class_2"))
    with pytest.raises(InputError, match=r"plain\.laz' has no points of class 2; extract its ground"):
        change_step(
            path, files["second"], tmp_path / "out", settings, dates=("2024-05-01", "2025-05-01"),
            transform_path=None, progress=Progress(),
        )  # fmt: skip
    assert not (tmp_path / "out").exists()


def test_registration_of_clouds_on_the_disk(files, tmp_path, on_disk):
    def run(folder: Path, **options) -> None:
        register_step(
            files["first"], files["second"], folder / "moved.laz", SETTINGS, transform_path=folder / "t.json",
            given=options.get("given"), invert=False, stable=None, progress=Progress(),
        )  # fmt: skip

    for name in ("held", "disk", "given"):
        (tmp_path / name).mkdir()
    run(tmp_path / "held")
    on_disk()
    run(tmp_path / "disk")
    assert contents(tmp_path / "disk") == contents(tmp_path / "held")
    run(tmp_path / "given", given=tmp_path / "held" / "t.json")
    moved = [(tmp_path / name / "moved.laz").read_bytes() for name in ("held", "given")]
    assert moved[0] == moved[1]


def test_inspection_of_clouds_on_the_disk(tmp_path, on_disk, monkeypatch):
    """By some of its points only where there are many: the record says by how many."""
    made = simulate_pair(SurveyParameters(points=60_000, length=16.0, height=9.0, seed=3))
    paths = write_pair(made, tmp_path / "survey")
    epochs = Epoch(paths["first"], date(2024, 5, 1)), Epoch(paths["second"], date(2025, 5, 1))
    settings = Settings(change=ChangeParameters(cell=0.5), screening=LastEpochParameters(screen_last_epoch=False))
    inspect_slope(epochs, tmp_path / "held", settings, roi=paths["roi"], progress=Progress())
    on_disk()
    inspect_slope(epochs, tmp_path / "disk", settings, roi=paths["roi"], progress=Progress())
    assert contents(tmp_path / "disk").keys() == contents(tmp_path / "held").keys()
    for name, held in contents(tmp_path / "held").items():
        if not name.endswith(".json"):
            assert contents(tmp_path / "disk")[name] == held, name
    assert figures(tmp_path / "disk") == figures(tmp_path / "held")


def test_many_points_are_registered_by_some_of_them(files, tmp_path, on_disk, monkeypatch):
    on_disk()
    monkeypatch.setattr(surveys, "MAX_POINTS", 6000)
    settings = Settings(registration=RegistrationParameters(maximum_offset=0.3))
    progress = Progress()
    register_step(
        files["first"], files["second"], tmp_path / "moved.laz", settings, transform_path=None,
        given=None, invert=False, stable=None, progress=progress,
    )  # fmt: skip
    stages = json.loads((tmp_path / "moved_run.json").read_text())["stages"]
    registered = next(stage for stage in stages if "registered_points" in json.dumps(stage))
    assert max(registered["registered_points"]) <= 6000


def test_the_ground_of_large_surveys_is_found_one_by_one(files, monkeypatch):
    points = sum(preflight(files[name]).count for name in ("first", "second"))
    clouds = [files["first"], files["second"]]
    monkeypatch.setattr(inspect, "MAX_POINTS_AT_ONCE", points)
    assert inspect.surveys_at_once(clouds) == 2
    assert inspect.surveys_at_once(clouds[:1]) == 1
    monkeypatch.setattr(inspect, "MAX_POINTS_AT_ONCE", points - 1)
    assert inspect.surveys_at_once(clouds) == 1

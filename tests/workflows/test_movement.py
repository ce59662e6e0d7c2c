"""What the zones of a change did, of surveys on the disk as of those in memory."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import pytest
from pyproj import CRS
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud import in_parts, point_squares
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.interface.parameters import ChangeParameters, MovementParameters
from slopewatch.tests.builders.what_ground_did import Ground
from slopewatch.workflows import motion_memory, pair
from slopewatch.workflows.change import change_step
from slopewatch.workflows.settings import Settings

DAYS = ("2024-05-01", "2025-05-01")


@pytest.fixture(scope="module")
def surveys(tmp_path_factory) -> list[Path]:
    """Rough ground of which a disc slid by 20 cm."""
    folder, ground = tmp_path_factory.mktemp("surveys"), Ground.at_rest()
    paths = [folder / f"{day}.laz" for day in DAYS]
    for path, xyz in zip(paths, (ground.first, ground.slid(0.2)), strict=True):
        write_cloud(path, PointCloud(xyz, CRS.from_epsg(32651), path))
    return paths


@pytest.fixture
def on_disk(monkeypatch) -> None:
    monkeypatch.setattr(pair, "MAX_HELD_POINTS", 0)
    monkeypatch.setattr(in_parts, "_PART_POINTS", 7000)
    monkeypatch.setattr(point_squares, "_SQUARE_POINTS", 500)


def changed(surveys: list[Path], folder: Path, memory: float = 2.0) -> list[str]:
    """The warnings of a change with what its zones did."""
    progress = Progress()
    settings = Settings(change=ChangeParameters(memory_limit=memory), movement=MovementParameters(movement=True))
    change_step(*surveys, folder, settings, dates=DAYS, transform_path=None, progress=progress)
    return progress.warnings


def test_surveys_on_the_disk_give_the_same_files(surveys, tmp_path, on_disk, monkeypatch):
    with monkeypatch.context() as held:
        held.setattr(pair, "MAX_HELD_POINTS", 10**6)
        warnings = changed(surveys, tmp_path / "held")
    assert changed(surveys, tmp_path / "disk") == warnings
    names = {path.name for path in (tmp_path / "held").iterdir()} - {"run.json", "report.html"}
    for name in names:  # but what tells when it was made
        assert (tmp_path / "disk" / name).read_bytes() == (tmp_path / "held" / name).read_bytes(), name
    zones = geopandas.read_file(tmp_path / "disk" / "zones.gpkg", layer="zones")
    assert "slid" in set(zones["movement"])


def test_a_zone_with_too_many_points_for_the_memory_is_said(surveys, tmp_path, on_disk, monkeypatch):
    monkeypatch.setattr(motion_memory, "_MOST_POINTS", 9000)
    monkeypatch.setattr(motion_memory, "_FEWEST_POINTS", 1000)
    warnings = changed(surveys, tmp_path / "out")
    assert any(w.startswith("What the zones did is not said. The memory allowed holds 9,000 points") for w in warnings)
    assert (tmp_path / "out" / "zones.gpkg").exists()


def test_the_report_of_ground_that_slid_speaks_of_no_loss(surveys, tmp_path):
    changed(surveys, tmp_path / "out")
    figures = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))["metrics"]
    assert figures["slid_zones"] == figures["zone_count"] > 0
    said = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    verdict = said.partition('<p class="verdict">')[2].partition("</p>")[0]
    assert "what moved there slid along the surface, by up to" in verdict
    assert "no material was lost or gained" in verdict
    assert "lost in zones that sank" not in verdict
    assert "largest lowering" not in verdict

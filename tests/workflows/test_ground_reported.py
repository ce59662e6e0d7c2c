"""What the commands tell of the ground's cover: in words while they run, in the run record, in their result."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from slopewatch.cli.reporting import JsonReporter
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch, parse_date
from slopewatch.engine.ground.cover import GroundCover, cover_facts, cover_table, percent
from slopewatch.engine.ground.result import GroundResult
from slopewatch.engine.pointcloud.cloud import PointCloud
from slopewatch.engine.pointcloud.pdal_program import Pdal
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.engine.pointcloud.writing import write_cloud
from slopewatch.interface.parameters import (
    GridChangeParameters,
    LastEpochParameters,
    RegistrationParameters,
    SeriesParameters,
)
from slopewatch.workflows import ground as ground_module
from slopewatch.workflows import inspect, series_preparation
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings, Settings


class Extraction:
    """Stands in for ``extract_ground`` on clouds whose points below 0.1 m over a known slope are ground."""

    def __init__(self) -> None:
        self.covers: list[GroundCover | None] = []
        self.cover = True

    def __call__(self, cloud: Path, output: Path, **_: object) -> GroundResult:
        points = read_cloud(cloud)
        height = points.xyz[:, 2] - 50 - 0.5 * (points.xyz[:, 1] - 3_500_000)
        ground = height < 0.1
        stem = output.stem.removesuffix("_ground")
        clipped, classified = (output.with_name(f"{stem}_{kind}.laz") for kind in ("clipped", "classified"))
        write_cloud(clipped, points)
        write_cloud(classified, points, classification=np.where(ground, 2, 1).astype(np.uint8))
        write_cloud(output, PointCloud(points.xyz[ground], points.crs, output))
        cover = cover_facts(points.xyz, ground, height, np.where(ground, 0.0, 0.02)) if self.cover else None
        self.covers.append(cover)
        count, found = len(ground), int(ground.sum())
        return GroundResult(
            ground=output, clipped=clipped, classified=classified, pipelines=(), raw_points=count, raw_area=100.0,
            raw_density=count / 100, roi_points=count, roi_area=100.0, roi_density=count / 100, ground_points=found,
            ground_ratio=found / count, vegetation_cover=0.5, outliers=0, spacing=0.1, plane_normal=(0.0, 0.0, 1.0),
            plane_dip=27.0, plane_azimuth=0.0, plane_share=1.0, scatter=0.01, threshold=0.06, filter="none",
            warnings=(), seconds={}, cover=cover,
        )  # fmt: skip


def told(cover: GroundCover) -> str:
    return (
        f"Ground is {percent(cover.ground_share)} of the points. Vegetation higher than 0.3 m covers 50 % of the "
        f"slope. {percent(cover.without_ground_share)} of the slope has no ground return."
    )


class Kept(Progress):
    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def show(self, level: str, message: str) -> None:
        self.said.append(message)


@pytest.fixture
def extraction(monkeypatch) -> Extraction:
    found = Extraction()
    for module in (ground_module, inspect, series_preparation):
        monkeypatch.setattr(module, "extract_ground", found)
    program = Pdal(None, "2.9.0", "for the test")
    monkeypatch.setattr("slopewatch.workflows.run.find_pdal", lambda *_: program)
    return found


def cloud(path: Path, seed: int = 0) -> Path:
    """A slope of 10 by 10 m, bare in its west and in its east under grass of 0.3 m."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, 10, (2, 20_000))
    grass = (x > 5) & (rng.uniform(size=x.size) < 0.9)
    z = 50 + 0.5 * y + np.where(grass, 0.3, 0.0) + rng.normal(0, 0.01, x.size)
    write_cloud(path, PointCloud(np.column_stack([500_000 + x, 3_500_000 + y, z]), CRS(32651), path))
    return path


def test_ground_tells_the_sentence_and_the_table(extraction, tmp_path, capsys):
    progress = JsonReporter()
    done = ground_module.ground_step(
        cloud(tmp_path / "a.laz"), tmp_path / "out_ground.laz", Settings(), roi=None, pdal=None, progress=progress
    )
    progress.result(done, [])
    [cover] = extraction.covers
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    said = [e["message"] for e in events if e["event"] == "log"]
    assert said == [told(cover), *cover_table(cover)]
    assert "Vegetation higher than 0.3 m covers 50 % of the slope." in said[0]
    result = events[-1]["metrics"]
    # vegetation has one share: that of its cover
    assert [name for name in result if "plants_share" in name or "bare" in name] == []
    assert result["vegetation_cover"] == 0.5
    assert result["plant_error_m"] == cover.error_m
    record = json.loads((tmp_path / "out_ground_run.json").read_text())
    assert record["metrics"]["without_ground_share"] == cover.without_ground_share
    assert record["stages"][0]["cover"]["classes"][1]["name"] == "low_plants"
    assert record["stages"][0]["cover"]["heights"]["returns"] == list(cover.heights.returns)


def test_without_a_cover_nothing_is_said(extraction, tmp_path):
    extraction.cover = False
    progress = Kept()
    metrics = ground_module.ground_step(
        cloud(tmp_path / "a.laz"), tmp_path / "out.laz", Settings(), roi=None, pdal=None, progress=progress
    ).figures
    assert progress.said == []
    assert "plant_error_m" not in metrics
    assert json.loads((tmp_path / "out_run.json").read_text())["stages"][0]["cover"] is None


def test_inspect_tells_it_of_both_surveys_and_shows_it(extraction, tmp_path):
    days = ("2024-05-01", "2025-05-01")
    epochs = [Epoch(cloud(tmp_path / f"{day}.laz", seed), parse_date(day)) for seed, day in enumerate(days)]
    settings = Settings(
        screening=LastEpochParameters(screen_last_epoch=False), registration=RegistrationParameters(method="none")
    )
    progress, out = Kept(), tmp_path / "out"
    metrics = inspect_slope(epochs, out, settings, progress=progress).figures
    record = json.loads((out / "run.json").read_text())
    for label, day in zip(("reference", "moving"), days, strict=True):
        kept = record["stages"][0]["epochs"][day]["cover"]
        [cover] = [c for c in extraction.covers if c is not None and c.ground_share == kept["ground_share"]]
        assert f"{day}: {told(cover)}" in progress.said
        assert metrics[f"{label}_plant_error_m"] == kept["error_m"]
    page = (out / "report.html").read_text()
    section = page[page.index('aria-labelledby="ground"') :]
    section = section[: section.index("</section>")]
    assert section.count("<img ") == 3
    for day in days:
        assert f'data-from="/stages/0/epochs/{day}/cover/classes/1/ground_share"' in section


def test_a_series_keeps_it_for_surveys_that_it_uses_again(extraction, tmp_path):
    days = ("2024-05-01", "2024-08-01", "2025-05-01")
    epochs = [Epoch(cloud(tmp_path / f"{day}.laz", seed), parse_date(day)) for seed, day in enumerate(days)]
    settings = SeriesSettings(
        registration=RegistrationParameters(method="none"),
        change=GridChangeParameters(cell=0.25),
        series=SeriesParameters(rasters_each_survey=False),
    )
    out = tmp_path / "out"
    progress = Kept()
    for count in (2, 3):
        monitor_series(epochs[:count], out, settings, progress=progress)
    assert len(extraction.covers) == 3
    sentences = [told(cover) for cover in extraction.covers if cover is not None]
    assert len(sentences) == 3
    assert all(sum(said.endswith(sentence) for said in progress.said) == 1 for sentence in sentences)
    page = (out / "report.html").read_text()
    # the first survey's cloud is of the earlier run, the last one's of this
    assert page.count("Ground returns a square metre") == 2
    for day in days:
        assert f'data-from="/stages/0/epochs/{day}/cover/error_m"' in page
    record = json.loads((out / "run.json").read_text())
    assert all((out / facts["classified"]).is_file() for facts in record["stages"][0]["epochs"].values())


def test_figures_without_a_cover_are_as_before(extraction, tmp_path):
    result = extraction(cloud(tmp_path / "a.laz"), tmp_path / "b.laz")
    bare = replace(result, cover=None).figures()
    assert result.figures().items() > bare.items()
    assert len(result.figures()) == len(bare) + 2

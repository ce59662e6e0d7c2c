"""Ground that one survey lost and the other has, through whole runs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    LastEpochParameters,
    SurveyParameters,
)
from slopewatch.interface.seen import COMPARED
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.workflows import inspect, series_preparation
from slopewatch.workflows.batch.kept_ground import keep_ground
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings, Settings

DAYS = "2024-05-01", "2025-05-01"
SETTINGS = Settings(
    change=ChangeParameters(cell=0.5),
    displacement_step=DisplacementStepParameters(displacement=False),
    screening=LastEpochParameters(screen_last_epoch=False),
)


def within(las, middle, radius=3.0):
    return np.hypot(np.asarray(las.x) - middle[0], np.asarray(las.y) - middle[1]) < radius


@dataclass
class Slope:
    """Two surveys of a slope in ``paths``; the extraction finds no ground of the later one about ``middle``.

    ``lost`` counts its points within 2 m of the middle, ``left`` those elsewhere.
    """

    paths: dict[str, Path]
    middle: np.ndarray
    lost: int = 0
    left: int = 0

    def extract(self, cloud, output, **options):
        found = extract_ground(cloud, output, **options)
        if cloud != self.paths["second"]:
            return found
        las = laspy.read(found.classified)
        labels = np.array(las.classification)
        there = within(las, self.middle) & (labels == 2)
        self.lost = int((there & within(las, self.middle, 2.0)).sum())
        las.classification[:] = np.where(there, 1, labels)
        las.write(found.classified)
        ground = laspy.read(found.ground)
        ground.points = ground.points[~within(ground, self.middle)]
        ground.write(found.ground)
        self.left = len(ground.points)
        return replace(found, ground_points=self.left)


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    pair = simulate_pair(SurveyParameters(points=25_000, length=24.0, height=10.0, vegetation=0.2, seed=5), changes=())
    return Slope(write_pair(pair, tmp_path_factory.mktemp("slope")), np.mean(pair.second.xyz[:, :2], axis=0))


@pytest.fixture(scope="module")
def run(slope, tmp_path_factory):
    out = tmp_path_factory.mktemp("shared") / "out"
    epochs = [Epoch(slope.paths[name], date.fromisoformat(day)) for name, day in zip(("first", "second"), DAYS)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect, "extract_ground", slope.extract)
        inspect.inspect_slope(epochs, out, SETTINGS, roi=slope.paths["roi"])
    return out, slope.middle, slope.lost


def test_ground_that_was_lost_is_ground_again(run):
    out, middle, lost = run
    classified, ground = (laspy.read(out / "clouds" / f"{DAYS[1]}_{name}.laz") for name in ("classified", "ground"))
    assert within(ground, middle, 2.0).sum() > 0.9 * lost
    of_class = np.asarray(classified.classification) == 2
    assert np.array_equal(classified.xyz[of_class], ground.xyz)
    assert np.array_equal(np.asarray(classified.plant_error)[of_class], np.asarray(ground.plant_error))
    assert np.isfinite(ground.plant_error).all()


def test_the_record_tells_of_it(run):
    out, _, _ = run
    record = json.loads((out / "run.json").read_text())
    (stage,) = (stage for stage in record["stages"] if stage["stage"] == "ground")
    for day in DAYS:
        facts, ground = stage["epochs"][day], out / "clouds" / f"{day}_ground.laz"
        assert facts["ground_points"] == facts["figures"]["ground_points"] == len(laspy.read(ground).points)
        assert facts["sha256"] == hashlib.sha256(ground.read_bytes()).hexdigest()
    assert record["metrics"]["moving_shared_points"] == stage["epochs"][DAYS[1]]["shared_points"] > 0
    assert stage["epochs"][DAYS[0]]["shared_points"] == 0


def test_the_place_is_compared(run):
    out, middle, _ = run
    with rasterio.open(out / "seen.tif") as seen:
        assert next(seen.sample([middle]))[0] == COMPARED


def test_a_series_makes_such_ground_anew(run, tmp_path):
    """A series finds the ground of each survey first, so it takes the first one's only."""
    assert keep_ground(run[0], tmp_path / "series") == 1


def test_a_series_completes_later_surveys_and_keeps_that(slope, tmp_path, monkeypatch):
    monkeypatch.setattr(series_preparation, "extract_ground", slope.extract)
    epochs = [Epoch(slope.paths[name], date.fromisoformat(day)) for name, day in zip(("first", "second"), DAYS)]
    settings = SeriesSettings(change=SETTINGS.change, displacement_step=SETTINGS.displacement_step)
    records = []
    for overwrite in (False, True):
        monitor_series(epochs, tmp_path / "out", settings, roi=slope.paths["roi"], overwrite=overwrite)
        record = json.loads((tmp_path / "out" / "run.json").read_text())
        records.append(record["stages"][0]["epochs"])
    facts = records[0][DAYS[1]]
    assert facts["shared_points"] > 0.9 * slope.lost
    assert facts["ground_points"] == slope.left + facts["shared_points"]
    ground = laspy.read(tmp_path / "out" / facts["classified"].replace("classified", "ground"))
    assert len(ground.points) == facts["ground_points"]
    assert within(ground, slope.middle, 2.0).sum() > 0.9 * slope.lost
    assert "shared_points" not in records[0][DAYS[0]]
    assert [entry["made"] for entry in records[1].values()] == [[], []]

"""Ground of raw surveys that are classified, or hold the ground alone, against the simulation's truth."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import date
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import rasterio
from affine import Affine
from rasterio.features import geometry_mask
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.grid.grid import Grid
from slopewatch.interface.parameters import (
    ChangeParameters,
    DisplacementStepParameters,
    LastEpochParameters,
    RawGroundParameters,
    RegistrationParameters,
    SeriesParameters,
    SurveyParameters,
    command_sets,
)
from slopewatch.interface.settings_file import read_settings
from slopewatch.simulation.surveys.survey import simulate_pair
from slopewatch.simulation.surveys.write import write_pair
from slopewatch.workflows.batch.kept_ground import keep_ground
from slopewatch.workflows.batch.settings import effective, ground_is_given
from slopewatch.workflows.ground_choice import check_ground, with_one_ground
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings, Settings

NO_MOTION = DisplacementStepParameters(displacement=False)


class Kept(Progress):
    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def show(self, level: str, message: str) -> None:
        self.said.append(message)


def classified(path: Path, labels) -> None:
    """Give the points the classes that ``labels`` makes of the truth."""
    las = laspy.read(path)
    las.classification = labels(np.asarray(las.truth_ground) == 1)
    las.write(path)


def of(ground: str) -> RawGroundParameters:
    return RawGroundParameters(ground=ground)


def settings_of(ground: str) -> Settings:
    return Settings(
        ground=of(ground),
        change=ChangeParameters(cell=0.5),
        displacement_step=NO_MOTION,
        screening=LastEpochParameters(screen_last_epoch=False),
    )


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """A pair under plants whose true ground has class 2."""
    pair = simulate_pair(SurveyParameters(points=60_000, length=24.0, height=10.0, amplitude=0.4, seed=3))
    paths = write_pair(pair, tmp_path_factory.mktemp("survey"))
    for name in ("first", "second"):
        classified(paths[name], lambda truth: np.where(truth, 2, 1).astype(np.uint8))
    return pair, paths


def epochs(paths) -> tuple[Epoch, Epoch]:
    return Epoch(paths["first"], date(2024, 5, 1)), Epoch(paths["second"], date(2025, 5, 1))


@pytest.fixture(scope="module")
def inspected(survey, tmp_path_factory):
    _, paths = survey
    out, progress = tmp_path_factory.mktemp("out") / "pair", Kept()
    return out, inspect_slope(epochs(paths), out, settings_of("class_2"), roi=paths["roi"], progress=progress), progress


def test_class_2_of_the_truth_gives_the_zones_and_volumes_of_the_truth(survey, inspected):
    pair, paths = survey
    out, done, _ = inspected
    truth = json.loads(paths["truth"].read_text())
    figures = done.figures
    for found, true in (("gain", truth["volume_raised_m3"]), ("loss", truth["volume_lowered_m3"])):
        assert abs(figures[f"vol_{found}_m3"] - true) < max(2 * figures[f"vol_{found}_err_m3"], 0.05 * true)
    with rasterio.open(out / "elevation_change.tif") as raster:
        grid = Grid(raster.transform.c, raster.transform.f, raster.transform.a, *raster.shape)
        dz = raster.read(1, masked=True).filled(np.nan)
    changed = pair.true_change_raster(grid)
    error = (dz - changed)[np.isfinite(dz)]
    assert abs(np.median(error)) < 0.01
    zones = geopandas.read_file(out / "zones.gpkg", layer="zones").to_crs(32651)
    inside = geometry_mask(zones.geometry, grid.shape, Affine(*grid.affine), invert=True)
    assert inside[np.abs(np.nan_to_num(changed)) > 0.2].mean() > 0.85
    assert np.mean(np.abs(changed[inside & np.isfinite(changed)]) > 0.005) > 0.7
    for kind, outline in zip(zones["kind"], zones.geometry, strict=True):
        within = geometry_mask([outline], grid.shape, Affine(*grid.affine), invert=True)
        assert np.sign(np.nanmean(changed[within])) == (1 if kind == "uplift" else -1)
    # two bumps, a scar and what slid from it
    assert len(zones) == 4


def test_record_report_and_log_say_which_ground_was_used(inspected):
    out, done, progress = inspected
    record = json.loads((out / "run.json").read_text())
    assert record["parameters"]["ground"]["ground"] == "class_2"
    [stage] = [stage for stage in record["stages"] if stage["stage"] == "ground"]
    for label, (day, facts) in zip(("reference", "moving"), stage["epochs"].items(), strict=True):
        true = np.count_nonzero(laspy.read(out / facts["clipped"]).truth_ground)
        assert facts["filter"] == "class 2 of the survey"
        assert done.figures[f"{label}_ground_points"] == true
        assert any(said.startswith(f"{day}: Ground: the points of class 2") for said in progress.said)
    # vegetation that nobody measured has no share
    named = [name for name in done.figures if "vegetation" in name or "plant_error_m" in name]
    assert named == ["objects_vegetation"]
    page = (out / "report.html").read_text()
    assert "The ground is the points of class 2 of the surveys" in page
    assert "single pulses reached" not in page


def test_a_series_goes_on_with_the_ground_that_inspect_took(survey, inspected, tmp_path):
    _, paths = survey
    pair, _, _ = inspected
    assert keep_ground(pair, tmp_path / "series") == 2
    series = SeriesSettings(
        ground=of("class_2"),
        change=ChangeParameters(cell=0.5),
        registration=RegistrationParameters(method="none"),
        displacement_step=NO_MOTION,
    )
    given = epochs(paths)
    monitor_series(given, tmp_path / "series", series, roi=paths["roi"])
    record = json.loads((tmp_path / "series" / "run.json").read_text())
    [stage] = [stage for stage in record["stages"] if stage["stage"] == "surveys"]
    assert [facts["made"] for facts in stage["epochs"].values()] == [["cells"], ["registration", "cells"]]
    # another ground is another series, and nothing of this one is used for it
    for other in ("extract", "as_is"):
        with pytest.raises(InputError, match="holds another series"):
            monitor_series(given, tmp_path / "series", replace(series, ground=of(other)), roi=paths["roi"])
    # a record of an earlier version does not name it
    del record["parameters"]["ground"]["ground"]
    (tmp_path / "series" / "run.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"holds another series \(ground was extract\)"):
        monitor_series(given, tmp_path / "series", series, roi=paths["roi"])


def test_the_older_name_of_as_is_still_works():
    ready = SeriesSettings(series=SeriesParameters(ground_ready=True))
    assert with_one_ground(ready) == with_one_ground(SeriesSettings(ground=of("as_is")))
    assert with_one_ground(ready).ground.ground == "as_is"
    assert with_one_ground(SeriesSettings()) == SeriesSettings()
    with pytest.raises(InputError, match="leave out ground_ready"):
        with_one_ground(replace(ready, ground=of("class_2")))
    assert [ground_is_given(given) for given in ({}, {"ground": "class_2"}, {"ground": "as_is"}, {"ground_ready": True})
    ] == [False, False, True, True]  # fmt: skip


@pytest.mark.parametrize("command", ["inspect", "series"])
def test_a_slope_of_a_batch_with_another_ground_is_not_done(command):
    made = [effective(command, {"ground": ground}, "default") for ground in ("extract", "class_2", "as_is")]
    assert [settings["ground"] for settings in made] == ["extract", "class_2", "as_is"]
    assert made[0] == effective(command, {}, "default")


def test_surveys_without_class_2_are_refused_before_any_work(survey, tmp_path):
    _, paths = survey
    plain = {name: tmp_path / paths[name].name for name in ("first", "second")}
    for name, path in plain.items():
        path.write_bytes(paths[name].read_bytes())
        classified(path, lambda truth: np.ones(len(truth), np.uint8))
    both, one = epochs(plain), epochs({"first": plain["first"], "second": paths["second"]})
    progress = Kept()
    with pytest.raises(InputError, match=r"has no points of class 2; set ground to extract\.$"):
        check_ground(both, "class_2", progress)
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"has no points of class 2 but .* has; set ground to extract, so that"):
        inspect_slope(one, out, settings_of("class_2"), progress=progress)
    series = [*epochs(paths), Epoch(plain["second"], date(2026, 5, 1))]
    with pytest.raises(InputError, match="has no points of class 2 but"):
        monitor_series(series, out, SeriesSettings(ground=of("class_2")), progress=progress)
    assert not out.exists()
    progress = Kept()  # offered only where all have it
    for given in (both, one):
        check_ground(given, "extract", progress)
    assert progress.said == []
    check_ground(epochs(paths), "extract", progress)
    assert progress.said == ["The surveys have points of class 2; set ground to class_2 to take these as the ground."]


@pytest.mark.parametrize("ground", ["class_2", "as_is"])
def test_the_choice_is_not_that_of_the_screening(ground):
    """Screening takes all of the ground that was taken; both parameters have the name."""
    given = LastEpochParameters.build({"ground": ground, "rotations": 2})
    assert (given.ground, given.rotations) == ("as_is", 2)


def test_settings_of_a_run_give_its_ground_back(inspected):
    out, _, _ = inspected
    found = read_settings(out / "run.json", command_sets.INSPECT)
    assert found.values["ground"] == "class_2"
    assert found.left_out == ()
    assert found.over(command_sets.INSPECT, "default").keys() == {"ground", "cell", "displacement", "screen_last_epoch"}
    assert "ground" not in read_settings(out / "run.json", command_sets.GROUND).values

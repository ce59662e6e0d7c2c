"""Epochs that do not go together: refused in one sentence before anything is written, or reported.

Numbered as the list of bad inputs; test_height_systems.py and test_odd_parameters.py have the others. What other files
test already and is not repeated in the three:
26 cli/test_commands.py (other crs, inspect in two systems), workflows/test_m3c2_refusals.py (test_reference_systems),
    workflows/test_series_refusals.py
27 refusals/test_odd_clouds.py (test_27), engine/crs/test_working_frame.py,
    engine/ground/test_extraction.py (test_feet_give_the_same...), workflows/test_m3c2.py
28, 29 engine/change/test_judgement.py (test_heights_of_two_systems_are_no_deformation),
    engine/zones/test_confirmation.py, workflows/test_m3c2_refusals.py
30 engine/change/test_difference.py, workflows/test_m3c2_refusals.py, workflows/test_series_refusals.py,
    cli/test_commands.py (no overlap)
31 accuracy/test_registration_limits.py (test_a_tiny_overlap_is_reported_and_an_overlap_of_nothing_refused)
32, 33 engine/epochs/test_epoch.py, engine/epochs/test_manifest.py, workflows/test_m3c2_refusals.py,
    cli/test_commands.py (same content, reversed, bad date)
34, 35, 36 engine/vector/test_area.py, engine/ground/test_extraction_refusals.py (region outside),
    engine/ground/test_extraction.py (a region in another system)
38 accuracy/test_registration_limits.py (three tests), engine/change/test_judgement.py (test_without_stable_ground...)
39 refusals/test_odd_clouds.py (test_39), engine/pointcloud/test_returns.py,
    engine/ground/test_extraction_refusals.py (test_return_numbers_that_make_no_sense_are_said)
47 engine/grid/test_geotiff.py (test_raster_is_what_the_contract_says)
48 interface/parameters/test_groups.py, cli/test_commands.py (bad number, nan, options that are not understood)
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import date

import laspy
import numpy as np
import pytest
import shapely
from slopewatch.engine.change.difference import difference
from slopewatch.engine.change.doubts import warn_of_doubtful_change
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.ground import extraction
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import (
    GroundParameters,
    InputParameters,
)
from slopewatch.tests.builders.epoch_pairs import (
    COARSE,
    SIDE,
    X,
    Y,
    change,
    inspect,
    m3c2,
    refused,
    region,
    register,
    series,
    slope,
    write,
)
from slopewatch.workflows.ground import ground_step
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import Settings


def test_26_other_reference_systems_are_refused_and_a_wrong_one_can_be_overridden(first):
    other = write(first.with_name("2025-05-01.laz"), slope(2), 32650)
    words = ("2024-05-01.laz in WGS 84 / UTM zone 51N", "2025-05-01.laz in WGS 84 / UTM zone 50N", "--crs")
    refused(first.parent, lambda: register(first, other), *words)
    refused(first.parent, lambda: inspect(first.parent, Epoch(first, None), Epoch(other, None)), *words)
    progress = Progress()
    outputs = register(first, other, progress, inputs=InputParameters(crs="EPSG:32651"), method="none").outputs
    assert laspy.read(outputs["aligned"]).header.parse_crs().to_epsg() == 32651
    record = json.loads(outputs["run"].read_text())
    assert any("zone 50N; the given" in note for note in read_cloud(other, InputParameters(crs="EPSG:32651")).notes)
    assert record["parameters"]["inputs"]["crs"] == "EPSG:32651"


@pytest.mark.parametrize("work", [register, change, m3c2])
def test_30_no_overlap_names_both_extents(first, work):
    other = write(first.with_name("2025-05-01.laz"), slope(2) + [300, 0, 0])
    refused(first.parent, lambda: work(first, other), "do not overlap", "500000.0", "500012.0", "500300.0", "500312.0")


def test_31_a_tiny_overlap_is_said():
    progress = Progress()
    warn_of_doubtful_change(difference(slope(1), slope(2) + [10.0, 0, 0], COARSE), progress)
    sentence = progress.warnings[0]
    assert [sentence] == [w for w in progress.warnings if "was seen by both surveys" in w]
    assert "check that both cover the same slope" in sentence or "cells of" in sentence


@pytest.mark.parametrize("name", ["2024-05-01.laz", "2025-05-01.laz", "another name.laz"])
def test_32_the_same_cloud_twice(first, name):
    folder = first.parent
    other = first.with_name(name)
    if other != first:
        shutil.copy(first, other)
    word = "both clouds" if other == first else "same cloud"
    refused(folder, lambda: register(first, other), word, first.name)
    pair = Epoch(first, date(2024, 5, 1)), Epoch(other, date(2025, 5, 1))
    refused(folder, lambda: inspect(folder, *pair), "same cloud", name, "two different epochs")
    refused(folder, lambda: series(folder, first, other), "same cloud", name)


@pytest.mark.parametrize(("days", "word"), [((2, 1), "reversed order"), ((1, 1), "same date")])
def test_33_dates_reversed_or_equal(first, days, word):
    folder = first.parent
    other = write(folder / "other.laz", slope(2))
    epochs = [Epoch(path, date(2024, 5, day)) for path, day in zip((first, other), days, strict=True)]
    refused(folder, lambda: inspect(folder, *epochs), word, "2024-05-01")
    refused(folder, lambda: monitor_series(epochs, folder / "out"), word, "2024-05-01")


def test_34_a_region_outside_of_the_clouds(first):
    other = write(first.with_name("2025-05-01.laz"), slope(2))
    area = region(first.with_name("roi.gpkg"), shapely.box(X + 500, Y, X + 520, Y + 20))
    pair = Epoch(first, date(2024, 5, 1)), Epoch(other, date(2025, 5, 1))
    words = ("roi.gpkg", "outside of the cloud", "x 500500.0 to 500520.0", "x 500000.0 to 500012.0", "check the area")
    refused(first.parent, lambda: inspect(first.parent, *pair, roi=area), *words)


def test_35_a_region_that_crosses_itself_is_repaired_and_said(watched):
    out, warnings = watched
    assert any("roi.geojson" in w and "crosses itself; it was repaired" in w for w in warnings)
    dz = read_raster(next((out / "cumulative").glob("*change*.tif"))).array
    # both triangles of the bow tie, west and east of the crossing
    assert np.isfinite(dz[:, :8]).sum() > 50
    assert np.isfinite(dz[:, -8:]).sum() > 50


def test_36_a_region_in_another_system_is_transformed(watched):
    out, warnings = watched
    assert any("roi.geojson" in w and "was transformed from WGS 84 to" in w for w in warnings)
    found = read_raster(next((out / "cumulative").glob("*change*.tif")))
    rows, columns = np.nonzero(np.isfinite(found.array))
    u = found.grid.west + (columns + 0.5) * 0.5 - X
    v = found.grid.north - (rows + 0.5) * 0.5 - Y
    assert (np.abs(u - 6) >= np.abs(v - 6)).all(), "north and south of the crossing there is no region"
    assert len(u) > 0.6 * 2 * SIDE**2 / 4 / 0.25


def test_37_no_ground_found(tmp_path, monkeypatch):
    """A closed crown over a dozen points; then a surface of which the refinement leaves nothing."""
    crown = slope(1) + [0, 0, 15]
    crown[:, 2] += np.random.default_rng(0).uniform(0, 8, len(crown))
    cloud = write(tmp_path / "crown.laz", np.vstack([crown, slope(2, 5)]))
    settings = Settings(ground=GroundParameters(denoise=False))

    def work():
        return ground_step(cloud, tmp_path / "g.laz", settings, roi=None, pdal=None, progress=Progress())

    refused(tmp_path, work, "of 6005 points", "crown.laz", "too few to be true", "check the units", "outliers")
    plain = extraction.refined

    def nothing(*arguments, **options):
        found = plain(*arguments, **options)
        return replace(found, ground=np.zeros_like(found.ground))

    monkeypatch.setattr(extraction, "refined", nothing)
    refused(tmp_path, work, "No ground was found in", "crown.laz", "check the units of its heights and its region")


def test_38_no_stable_ground_is_refused_or_accepted_with_a_wide_level(first):
    """Every square metre rose or sank by up to a metre, each its own way."""
    xyz = slope(2)
    steps = np.random.default_rng(8).uniform(-1.0, 1.0, (12, 12))
    xyz[:, 2] += steps[(xyz[:, 0] - X).astype(int), (xyz[:, 1] - Y).astype(int)]
    other = write(first.with_name("2025-05-01.laz"), xyz)
    with pytest.raises(InputError, match="--accept-unstable"):
        register(first, other)
    progress = Progress()
    done = register(first, other, progress, accept_unstable=True)
    outputs, metrics = done.outputs, done.figures
    assert any("No stable ground was found" in w and "give an area known to be stable" in w for w in progress.warnings)
    assert np.array_equal(json.loads(outputs["transform"].read_text())["matrix"], np.eye(4))
    error = metrics["registration_error_m"]
    assert error > 0.2
    wide, narrow = (difference(slope(1), xyz, COARSE, registration_error=e).median_level for e in (error, 0.0))
    assert wide == pytest.approx(np.hypot(1.96 * error, narrow), rel=0.3)

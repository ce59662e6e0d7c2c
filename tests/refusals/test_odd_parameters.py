"""Rasters' nodata as every reader takes it, and malformed parameters refused before any work.

Numbered as the list of bad inputs; test_epoch_pairs.py has the others.
"""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from click.testing import CliRunner
from slopewatch.cli.program import cli
from slopewatch.engine.core import cancellation
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.report.compose import write_report
from slopewatch.tests.builders.epoch_pairs import COARSE


def test_47_every_raster_has_no_nan_and_says_its_nodata(risen, watched):
    rasters = [path for out, _ in (risen, watched) for path in sorted(out.rglob("*.tif"))]
    assert {"elevation_change.tif", "surface_heights.tif", "m3c2_distance.tif"} <= {p.name for p in rasters}
    gaps = 0
    for path in rasters:
        with rasterio.open(path) as source:
            if source.dtypes[0] == "uint8":
                continue  # a picture, with transparency
            assert set(source.nodatavals) == {-9999.0}, path.name
            values = source.read()
            assert np.isfinite(values).all(), path.name
            gaps += np.count_nonzero(values == -9999.0)
    assert gaps > 100


@pytest.mark.parametrize("declared", [-9999.0, float("nan"), None])
def test_47_readers_take_nan_and_9999_for_no_data(risen, tmp_path, declared):
    """As another program leaves a raster behind: some gaps NaN, others -9999."""
    out, _ = risen
    for path in (p for p in out.iterdir() if p.suffix in (".tif", ".json", ".gpkg", ".csv", ".png")):
        shutil.copy(path, tmp_path)
    changed = 0
    for path in sorted(tmp_path.glob("*.tif")):
        expected = read_raster(path).array
        with rasterio.open(path) as source:
            profile, values = source.profile, source.read()
            texts = source.descriptions, source.units, source.tags()
        if values.dtype != np.float32:
            continue
        gaps = np.argwhere(values == -9999.0)
        values[tuple(gaps[::2].T)] = np.nan
        changed += len(gaps)
        with rasterio.open(path, "w", **{**profile, "driver": "GTiff", "nodata": declared}) as target:
            target.write(values)
            target.descriptions, target.units = texts[0], texts[1]
            target.update_tags(**texts[2])
        assert np.array_equal(read_raster(path).array, expected, equal_nan=True), path.name
    assert changed > 100
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert page == (out / "report.html").read_text(encoding="utf-8")


OPTIONS = [
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--maximum-offset", "nan"], "maximum_offset is nan"),
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--registration-voxel", "-1"], "registration_voxel is -1"),
    (["register", "a.laz", "b.laz", "--output", "c.laz", "--method", "best"], "'--method'"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--cell", "inf"], "cell is inf"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--confidence", "95"], "confidence is 95"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--minimum-points", "1.5"], "'--minimum-points'"),
    (["change", "a.laz", "b.laz", "--output-dir", "out", "--cel-size", "1"], "--cel-size"),
    (["m3c2", "a.laz", "b.laz", "--output", "c.laz", "--normal-scale", "-0.5"], "normal_scale is -0.5"),
    (["m3c2", "a.laz", "b.laz", "--output", "c.laz", "--half-length", "nan"], "half_length is nan"),
    (["series", "folder", "--output-dir", "out", "--cell", "wide"], "'--cell'"),
    (["series", "folder", "--output-dir", "out", "--cell", "-1"], "cell is -1"),
    (
        ["inspect", "--epoch", "2024-05-01=a.laz", "--output-dir", "out", "--cloth-resolution", "nan"],
        "cloth_resolution",
    ),
    (["inspect", "--epoch", "1 May=a.laz", "--output-dir", "out"], "YYYY-MM-DD"),
    (["ground", "a.laz", "--output", "g.laz", "--rigidness", "7"], "rigidness is 7"),
    (["ground", "a.laz", "--output", "g.laz", "--profile", "mine"], "'--profile'"),
]


@pytest.mark.parametrize(("arguments", "word"), OPTIONS, ids=[" ".join(a[-2:]) for a, _ in OPTIONS])
def test_48_malformed_parameters_are_refused_before_any_work(arguments, word, tmp_path, monkeypatch):
    """The clouds do not even exist: the parameter is named, not they."""
    monkeypatch.setattr(cancellation, "install", lambda *_, **__: None)
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 2
    sentence = done.stderr.strip().splitlines()[-1]
    assert sentence.startswith("Error: ")
    assert sentence.endswith((".", "?)"))  # (Did you mean '--cell'?)
    assert word in sentence
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [float("nan"), -1.0, "wide", None, True])
def test_48_values_from_python_are_checked_too(value):
    with pytest.raises(ValueError, match=r"cell is .*; give a number from"):
        replace(COARSE, cell=value)

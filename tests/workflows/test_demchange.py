"""The change between elevation models of a known surface, as a whole run."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.interface.parameters import ModelParameters
from slopewatch.tests.builders.elevation_models import NORTH, WEST, hills, noise, write_model, write_turned
from slopewatch.workflows.conclusions import conclusion
from slopewatch.workflows.demchange import demchange_step, parse_model
from slopewatch.workflows.settings import ModelSettings

_SHAPE = (160, 180)
_HOLE = np.s_[60:85, 90:120]
_BIASES = (0.0, -0.544, 0.2)
_LOWERED = (0.0, -0.6, -1.2)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three models: a hollow that deepens, each campaign with a bias, the second shifted in plan."""
    folder = tmp_path_factory.mktemp("dems")
    texts = []
    for i, (bias, lowered) in enumerate(zip(_BIASES, _LOWERED, strict=True)):
        heights = hills(*_SHAPE, east=0.6 * (i == 1)) + noise(_SHAPE, 0.03, 4.0, i) + bias
        heights[_HOLE] += lowered
        texts.append(f"{2015 + i}-01-01={write_model(folder / f'{i}.tif', heights)}")
    progress = Progress()
    demchange_step([parse_model(text) for text in texts], folder / "out", ModelSettings(), progress=progress)
    assert progress.warnings == []
    return folder / "out"


def test_the_biases_are_named_and_are_no_change(made: Path) -> None:
    record = json.loads((made / "run.json").read_text(encoding="utf-8"))
    found = {(row["from"][:4], row["to"][:4]): row for row in record["coregistration"]}
    for (first, last), row in found.items():
        truth = _BIASES[int(last) - 2015] - _BIASES[int(first) - 2015]
        assert row["bias_m"] == pytest.approx(truth, abs=3.5 * row["bias_error_m"])
        assert row["bias_error_m"] < 0.02
        assert "a bias of the campaign or of its vertical datum" in row["sentences"][0]
    assert found["2015", "2016"]["shift_east_m"] == pytest.approx(0.6, abs=0.05)
    assert record["metrics"]["bias_m"] == pytest.approx(0.2, abs=0.02)


def test_the_hollow_is_the_one_zone_and_its_volume_is_within_its_error(made: Path) -> None:
    zones = read_layer(made / "zones.gpkg", "zones")
    assert len(zones) == 1
    truth = _LOWERED[2] * 25 * 30
    assert zones.loc[0, "vol_net_m3"] == pytest.approx(truth, abs=3 * zones.loc[0, "vol_err_m3"])
    assert zones.loc[0, "vol_err_m3"] < 0.05 * abs(truth)
    with (made / "zone_series.csv").open(encoding="utf-8") as file:
        series = {(row["from"][:4], row["to"][:4]): row for row in csv.DictReader(file)}
    for pair, lowered in {("2015", "2016"): -0.6, ("2015", "2017"): -1.2, ("2016", "2017"): -0.6}.items():
        row = series[pair]
        assert float(row["vol_net_m3"]) == pytest.approx(lowered * 750, abs=3.5 * float(row["vol_err_m3"]))


def test_rasters_state_change_level_significance_and_rate(made: Path) -> None:
    change, level, significance = (
        read_raster(made / f"{name}.tif") for name in ("elevation_change", "level_of_detection", "significance")
    )
    inner = np.s_[63:82, 93:117]
    assert np.median(change.array[inner]) == pytest.approx(-1.2, abs=0.03)
    assert level.unit == change.unit == "m"
    ratio = np.abs(significance.array) * level.array / np.abs(change.array)
    assert np.nanmedian(ratio) == pytest.approx(1.96, abs=0.01)
    assert float(change.tags["COREG_DZ"]) == pytest.approx(-0.2, abs=0.02)
    rate, error = (read_raster(made / "rate.tif", band).array for band in (1, 2))
    assert np.median(rate[inner]) == pytest.approx(-600.0, abs=20)
    away = np.ones(_SHAPE, dtype=bool)
    away[55:90, 85:125] = False
    known = away & np.isfinite(rate)
    assert 0.5 < np.std(rate[known]) / np.median(error[known]) < 1.3


def test_the_report_tells_of_models_and_not_of_points(made: Path) -> None:
    text = " ".join((made / "report.html").read_text(encoding="utf-8").split())
    assert "Bias and shift of the later model on stable ground" in text
    assert "curvature (1/m)" in text
    assert "2017-01-01 lies 0.2" in text.split("Movement of everything alike")[1][:80]
    assert "Ground points a square metre" not in text
    assert "the errors of both models, which follow slope, curvature and roughness" in text
    assert not (made / "point_counts.tif").exists()


def test_pairs_are_those_with_the_first_and_the_steps(made: Path) -> None:
    with (made / "pairs.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["from"][:4], row["to"][:4], row["kind"]) for row in rows] == [
        ("2015", "2016", "against the first"),
        ("2015", "2017", "against the first"),
        ("2016", "2017", "step"),
    ]
    for row in rows:
        assert 0.03 < float(row["stable_beyond_share"]) < 0.07
        assert (made / "pairs").is_dir()
    assert len(list((made / "pairs").glob("*.tif"))) == 6


def test_the_same_models_give_the_same_bytes(tmp_path: Path) -> None:
    files = []
    for i, cell, shape in ((0, 1.0, (80, 90)), (1, 2.0, (40, 45))):
        heights = hills(*shape, cell) + noise(shape, 0.05, 3.0, i)
        files.append(write_model(tmp_path / f"{i}.tif", heights, cell=cell))
    outs = []
    for name in ("a", "b"):
        demchange_step([parse_model(str(f)) for f in files], tmp_path / name, ModelSettings(), progress=Progress())
        outs.append({p.name: p.read_bytes() for p in (tmp_path / name).glob("*.tif")})
    assert outs[0] == outs[1]
    record = json.loads((tmp_path / "a" / "run.json").read_text(encoding="utf-8"))
    assert record["grid"]["cell_m"] == 2.0
    assert "were averaged to those of 2 m" in record["one_grid"][0]


def test_a_turned_oblong_model_is_compared_as_any_other(tmp_path: Path) -> None:
    """Its hollow has its volume within the error, nothing else is a zone, and record and report say what was done."""

    def hollow(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where((np.abs(x - 75) < 15) & (np.abs(y + 80) < 12), -0.8, 0.0) + 0.15

    plain = write_model(tmp_path / "2015-01-01.tif", hills(*_SHAPE) + noise(_SHAPE, 0.03, 0.0, 1))
    turned = write_turned(
        tmp_path / "2016-01-01.tif", 27.0, (1.0, 0.8), (230, 200), middle=(WEST + 90, NORTH - 80), noise_m=0.03,
        raised=hollow,
    )  # fmt: skip
    progress = Progress()
    models = [parse_model(str(path)) for path in (plain, turned)]
    demchange_step(models, tmp_path / "out", ModelSettings(), progress=progress)
    record = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    sentence = "cells of 1 by 0.8 m, turned by 27 degrees; their heights were interpolated to a north-up grid of 1 m"
    assert sentence in record["one_grid"][0]
    assert sentence in " ".join((tmp_path / "out" / "report.html").read_text(encoding="utf-8").split())
    assert record["grid"]["cell_m"] == 1.0
    assert record["metrics"]["bias_m"] == pytest.approx(0.15, abs=0.02)
    zones = read_layer(tmp_path / "out" / "zones.gpkg", "zones")
    assert len(zones) == 1
    assert zones.loc[0, "vol_net_m3"] == pytest.approx(-0.8 * 30 * 24, abs=3 * zones.loc[0, "vol_err_m3"])
    assert zones.loc[0, "vol_err_m3"] < 0.05 * 0.8 * 30 * 24
    with (tmp_path / "out" / "pairs.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert 0.03 < float(row["stable_beyond_share"]) < 0.07


def _tilted(folder: Path) -> list[str]:
    """Two models whose later one leans by 0.5 m over the map, with a hollow of 0.3 m."""
    first, second = (hills(*_SHAPE) + noise(_SHAPE, 0.03, 4.0, i) for i in (1, 2))
    second += 0.5 * np.arange(_SHAPE[1]) / (_SHAPE[1] - 1)
    second[_HOLE] -= 0.3
    return [
        str(write_model(folder / f"{year}-01-01.tif", heights)) for year, heights in ((2015, first), (2016, second))
    ]


def _compared(texts: list[str], folder: Path, **options: bool) -> tuple[dict, Progress, RunResult]:
    progress = Progress()
    settings = ModelSettings(elevation_models=ModelParameters(**options))
    result = demchange_step([parse_model(text) for text in texts], folder, settings, progress=progress)
    return json.loads((folder / "run.json").read_text(encoding="utf-8")), progress, result


def test_a_tilt_is_warned_of_and_named_everywhere_and_taken_off_if_asked(tmp_path: Path) -> None:
    texts = _tilted(tmp_path)
    kept, warned, _ = _compared(texts, tmp_path / "kept")
    (warning,) = warned.warnings
    assert "differ by a tilt of 0." in warning
    assert "Take off a tilt or bend" in warning
    assert kept["metrics"]["tilt_m"] == pytest.approx(0.5, abs=0.03)
    assert kept["metrics"]["trend_taken_off"] is False
    record, progress, result = _compared(texts, tmp_path / "taken", tilt=True)
    assert progress.warnings == []
    page = " ".join((tmp_path / "taken" / "report.html").read_text(encoding="utf-8").split())
    for text in (page, " ".join(conclusion("demchange", result))):
        assert re.search(r"differ by a tilt of 0\.(49|50|51)", text)
    assert record["coregistration"][0]["trend"] == "tilt"
    assert record["metrics"]["lod_median_m"] < 0.5 * kept["metrics"]["lod_median_m"]
    zone = read_layer(tmp_path / "taken" / "zones.gpkg", "zones").iloc[0]
    assert zone["vol_net_m3"] == pytest.approx(-0.3 * 750, abs=3 * zone["vol_err_m3"])


def test_areas_and_volumes_of_zone_and_footprint_stand_side_by_side(made: Path) -> None:
    zone = read_layer(made / "zones.gpkg", "zones").iloc[0]
    assert zone["zone_net_m3"] == pytest.approx(zone["dz_mean_m"] * zone["area_m2"])
    assert zone["area_m2"] < zone["vol_area_m2"]
    assert 0 < zone["zone_err_m3"] < 0.1 * abs(zone["zone_net_m3"])
    metrics = json.loads((made / "run.json").read_text(encoding="utf-8"))["metrics"]
    assert metrics["footprint_area_m2"] == pytest.approx(zone["vol_area_m2"])
    assert metrics["zone_net_m3"] == pytest.approx(zone["zone_net_m3"])
    page = (made / "report.html").read_text(encoding="utf-8")
    places = [
        page.index(f'data-from="/zones/0/{name}"') for name in ("area_m2", "zone_net_m3", "vol_area_m2", "vol_net_m3")
    ]
    assert places == sorted(places)
    assert places[-1] - places[0] < 1000


def test_statistics_alone_are_those_of_the_whole_run_without_its_files(tmp_path: Path) -> None:
    texts = _tilted(tmp_path)
    record, _, result = _compared(texts, tmp_path / "brief", tilt=True, statistics_only=True)
    assert sorted(p.name for p in (tmp_path / "brief").iterdir()) == ["pairs.csv", "run.json"]
    whole = _compared(texts, tmp_path / "whole", tilt=True)[0]["pairs"][0]
    assert record["pairs"][0].items() <= {**whole, "all_net_err_m3": record["pairs"][0]["all_net_err_m3"]}.items()
    assert record["metrics"]["beyond_m2"] == pytest.approx(750 + 0.05 * (160 * 180 - 750), rel=0.2)
    words = " ".join(conclusion("demchange", result))
    assert "differ by a tilt of 0." in words
    assert "of the cells" in words
    assert "zone" not in words
    with pytest.raises(InputError, match="a folder of their own"):
        demchange_step(
            [parse_model(text) for text in texts], tmp_path / "whole",
            ModelSettings(elevation_models=ModelParameters(statistics_only=True)), overwrite=True, progress=Progress(),
        )  # fmt: skip

"""Elevation models that cannot be compared are refused in one sentence with the figure; odd ones are reported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.tests.builders.elevation_models import NORTH, WEST, hills, noise, write_model
from slopewatch.workflows.demchange import demchange_step, parse_model
from slopewatch.workflows.settings import ModelSettings

_SHAPE = (80, 90)
_COMPOUND = "EPSG:2154+{}"
Write = Callable[..., Path]


def _heights(seed: int) -> np.ndarray:
    return hills(*_SHAPE) + noise(_SHAPE, 0.05, 3.0, seed)


@pytest.fixture
def first(tmp_path: Path) -> Path:
    return write_model(tmp_path / "first.tif", _heights(1))


def _run(*models: Path | str) -> Progress:
    progress = Progress()
    folder = Path(str(models[0]).split("=")[-1]).parent / "out"
    demchange_step([parse_model(str(m)) for m in models], folder, ModelSettings(), progress=progress)
    return progress


def _refused(words: str, *models: Path | str) -> None:
    with pytest.raises(InputError) as caught:
        _run(*models)
    sentence = str(caught.value)
    assert words in sentence, sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    folder = Path(str(models[0]).split("=")[-1]).parent / "out"
    assert not folder.exists() or not list(folder.iterdir())


def test_no_overlap(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", _heights(2), west=WEST + 590)
    _refused("do not overlap: they lie 500 m apart", first, second)


def test_a_sliver_of_overlap(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", _heights(2), west=WEST + 89)
    _refused("80 cells with heights of both, fewer than 200", first, second)


def test_two_vertical_systems(tmp_path: Path) -> None:
    models = [
        write_model(tmp_path / f"{code}.tif", _heights(code), crs=_COMPOUND.format(code)) for code in (5720, 5773)
    ]
    _refused("and '" + str(models[1]) + "' in EGM96 height; bring both to one vertical system", *models)


def test_one_vertical_system_that_is_not_declared(tmp_path: Path) -> None:
    models = [
        write_model(tmp_path / "a.tif", _heights(1), crs=_COMPOUND.format(5720)),
        write_model(tmp_path / "b.tif", _heights(2), crs="EPSG:2154"),
    ]
    assert any("declares no vertical system" in sentence for sentence in _run(*models).warnings)


def test_an_ellipsoid_against_a_geoid(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", _heights(2) + 42.0)
    _refused(" m above ", first, second)


def test_feet_against_metres(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", _heights(2) / 0.3048)
    _refused("3.281 times those of", first, second)
    said = write_model(tmp_path / "said.tif", _heights(2) / 0.3048, unit="ft")
    assert any("converted from international feet" in sentence for sentence in _run(first, said).warnings)


def test_whole_metres_are_reported_with_their_error(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", np.round(_heights(2)), dtype="int16")
    warnings = _run(first, second).warnings
    assert any("whole multiples of 1 m; each errs by 0.29 m" in sentence for sentence in warnings)


def test_a_hillshade(first: Path, tmp_path: Path) -> None:
    shade = np.clip(128 + 60 * np.random.default_rng(1).normal(size=_SHAPE), 0, 255)
    picture = write_model(tmp_path / "s.tif", shade, dtype="uint8", nodata=0)
    _refused("holds whole numbers of 8 bits, as a hillshade", first, picture)
    _refused("they show other ground, or one is no elevation model", first, write_model(tmp_path / "f.tif", shade))


def test_a_geographic_system_and_none(first: Path, tmp_path: Path) -> None:
    degrees = write_model(tmp_path / "d.tif", _heights(2), crs="EPSG:4326", cell=1e-5, west=123.0, north=29.8)
    _refused("which is geographic (degrees); warp it to a projected one", first, degrees)
    _refused("declares no coordinate reference system", first, write_model(tmp_path / "n.tif", _heights(2), crs=None))


def test_several_bands_and_no_raster(first: Path, tmp_path: Path) -> None:
    both = write_model(tmp_path / "two.tif", np.stack([_heights(2), _heights(3)]))
    _refused("has 2 bands; an elevation model has one", first, both)
    text = tmp_path / "text.tif"
    text.write_text("no raster", encoding="utf-8")
    _refused("a GeoTIFF; give one", first, text)


def test_the_same_file_and_the_same_heights(first: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.tif"
    again.write_bytes(first.read_bytes())
    _refused("are the same file", first, again)
    same = write_model(again, _heights(1), north=NORTH, unit="m")
    _refused("have the same height in all 7,200 common cells", first, same)
    raised = write_model(again, _heights(1) + 0.1, north=NORTH, unit="m")
    _refused("differ by the same 0.100 m in all 7,200 common cells", first, raised)


def test_holes_and_values_that_are_no_heights(first: Path, tmp_path: Path) -> None:
    holed = _heights(2)
    holed[10:20, 10:30] = np.nan
    holed[40:42, 40:45] = -32768.0
    progress = _run(first, write_model(tmp_path / "second.tif", holed, nodata=None))
    assert any("10 cells whose values are no heights on Earth" in sentence for sentence in progress.warnings)


def test_no_height_at_all(first: Path, tmp_path: Path) -> None:
    nothing = write_model(tmp_path / "none.tif", np.full(_SHAPE, np.nan))
    _refused("holds no height in any of its 7200 cells", first, nothing)


def test_days_in_reversed_order_and_one_model(first: Path, tmp_path: Path) -> None:
    second = write_model(tmp_path / "second.tif", _heights(2))
    _refused("not later than", f"2020-01-01={first}", f"2019-01-01={second}")
    _refused("1 elevation model was given; give two or more", first)
    _refused("does not exist", first, tmp_path / "missing.tif")


def test_less_stable_ground_than_a_shift_is_found_from(first: Path, tmp_path: Path) -> None:
    second, stable = write_model(tmp_path / "second.tif", _heights(2)), tmp_path / "stable.gpkg"
    square = shapely.box(WEST + 20, NORTH - 29, WEST + 29, NORTH - 20)  # 81 cells
    geopandas.GeoDataFrame(geometry=[square], crs="EPSG:32651").to_file(stable)
    models = [parse_model(f"{2020 + i}-01-01={path}") for i, path in enumerate((first, second))]
    words = r"fewer than 100 common cells of stable ground; .* larger --stable area"
    with pytest.raises(InputError, match=words):
        demchange_step(models, tmp_path / "out", ModelSettings(), stable=stable, progress=Progress())

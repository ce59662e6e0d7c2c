"""Chainages by M values: each corner has its own, and what cannot be one is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.road.centreline import read_roads
from slopewatch.engine.road.network import Network, Place
from slopewatch.interface.parameters import RoadParameters
from slopewatch.tests.builders.measured_lines import write_measured_gpkg, write_measured_shapefile

UTM = CRS.from_epsg(32651)
X, Y = 500_000.0, 2_500_000.0
BENT = np.array([[0, 0, 1000], [50, 0, 1055], [50, 0, 1055], [100, 0, 1100], [100, 80, 1184]], float)
"""x, y, m: 55, 45 and 84 m of chainage on 50, 50 and 80 m of line, with a corner twice."""


def zm(line: np.ndarray, height: float = 7.0) -> np.ndarray:
    return np.column_stack([line[:, 0] + X, line[:, 1] + Y, np.full(len(line), height), line[:, 2]])


def moved(line: np.ndarray) -> np.ndarray:
    return line + (X, Y, 0)


def roads(path: Path, **parameters: object) -> tuple[Network, tuple[str, ...]]:
    return read_roads(path, UTM, RoadParameters(**parameters)).network()


def at(network: Network, x: float, y: float) -> Place:
    place = network.place_of(shapely.Point(X + x, Y + y))
    assert isinstance(place, Place), place
    return place


def expected(x: float, y: float) -> float:
    """By hand: linear between the corners."""
    way = x if y < 5 else 100 + y
    return float(np.interp(way, [0, 50, 100, 180], [1000, 1055, 1100, 1184]))


@pytest.fixture(params=["gpkg", "shapefile"])
def bent(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "gpkg":
        return write_measured_gpkg(tmp_path / "road.gpkg", [zm(BENT)], route=["S1"])
    return write_measured_shapefile(tmp_path / "road.shp", [[moved(BENT)]])


def test_chainage_is_linear_between_the_corners(bent: Path) -> None:
    network, _ = roads(bent)
    for x, y in ((10, 2), (49, 2), (51, 2), (90, 3), (103, 20), (103, 79)):
        assert at(network, x, y).chain_from == pytest.approx(expected(x, y), abs=1e-6), (x, y)
    assert at(network, 10, 2).side == "left"


def test_falling_m_values_turn_the_line(tmp_path: Path) -> None:
    back = BENT[::-1]
    network, _ = roads(write_measured_gpkg(tmp_path / "road.gpkg", [zm(back)]))
    assert at(network, 10, 2).chain_from == pytest.approx(expected(10, 2), abs=1e-6)
    assert at(network, 10, 2).side == "left"


def test_parts_have_their_own_and_gaps_between_them_have_no_place(tmp_path: Path) -> None:
    parts = [moved(BENT[:2]), moved(np.array([[150, 0, 1200], [250, 0, 1310]], float))]
    network, _ = roads(write_measured_shapefile(tmp_path / "road.shp", [parts]))
    assert at(network, 200, 2).chain_from == pytest.approx(1255, abs=1e-6)
    assert at(network, 25, 2).chain_from == pytest.approx(1027.5, abs=1e-6)
    assert isinstance(network.place_of(shapely.Point(X + 100, Y + 2)), str)


def test_the_unit_and_another_reference_system(tmp_path: Path) -> None:
    feet = zm(BENT)
    feet[:, 3] /= 0.3048
    feet[:, :2] = np.column_stack(Transformer.from_crs(32651, 4326, always_xy=True).transform(feet[:, 0], feet[:, 1]))
    path = write_measured_gpkg(tmp_path / "road.gpkg", [feet], crs="EPSG:4326")
    network, notes = roads(path, chainage_unit="ft")
    assert at(network, 10, 2).chain_from == pytest.approx(expected(10, 2), abs=0.01)
    assert any("transformed" in note for note in notes)
    with pytest.raises(InputError, match="--chainage-unit"):
        roads(path)


def test_fields_come_first(tmp_path: Path) -> None:
    path = write_measured_gpkg(tmp_path / "road.gpkg", [zm(BENT)], chain_from=[0.0], chain_to=[180.0])
    network, notes = roads(path)
    assert at(network, 10, 2).chain_from == pytest.approx(10.0)
    assert any("M values are not used" in note for note in notes)


@pytest.mark.parametrize("value", [0.0, np.nan, -1.8e308])
def test_m_values_that_say_nothing_are_as_none(tmp_path: Path, value: float) -> None:
    line = BENT.copy()
    line[:, 2] = value
    network, notes = roads(write_measured_gpkg(tmp_path / "road.gpkg", [zm(line)]), chainage_start=500.0)
    assert at(network, 10, 2).chain_from == pytest.approx(510.0)
    assert notes == ()


@pytest.mark.parametrize(
    ("corner", "value", "words"),
    [(1, 1120.0, "turn round at x 500100.0, y 2500000.0"), (3, np.nan, "at 3 of its 4 corners")],
)
def test_m_values_that_turn_round_or_have_gaps_are_refused(
    tmp_path: Path, corner: int, value: float, words: str
) -> None:
    line = np.delete(BENT, 2, axis=0)
    line[corner, 2] = value
    path = write_measured_gpkg(tmp_path / "road.gpkg", [zm(line)])
    with pytest.raises(InputError) as refused:
        roads(path)
    sentence = str(refused.value)
    assert words in sentence
    assert "road.gpkg" in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence

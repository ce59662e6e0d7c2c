"""A simulated survey with its region, and the ground extracted from it by the real PDAL."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.result import GroundResult
from slopewatch.engine.pointcloud.pdal_program import Pdal, find_pdal
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair

SURVEY = SurveyParameters(seed=3, points=90_000, length=18.0, height=9.0)


@pytest.fixture(scope="session")
def pair() -> SimulatedPair:
    return simulate_pair(SURVEY)


def write(pair: SimulatedPair, path: Path, change: Callable[[laspy.LasData], None] | None = None) -> Path:
    """The first survey as LAS 1.4 with its truth as user data, and a unique GPS time a point."""
    cloud = pair.first
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [*np.floor(cloud.xyz.mean(axis=0))]
    header.add_crs(CRS.from_user_input(pair.crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.xyz.T
    las.return_number, las.number_of_returns = cloud.return_number, cloud.number_of_returns
    las.gps_time, las.user_data, las.intensity = np.arange(len(cloud)), cloud.truth_ground, cloud.intensity
    las.red, las.green, las.blue = cloud.rgb.T.astype(np.uint16) * 257
    if change is not None:
        change(las)
    las.write(path)
    return path


@pytest.fixture(scope="session")
def inputs(pair, tmp_path_factory) -> tuple[Path, Path]:
    """Cloud and region."""
    folder = tmp_path_factory.mktemp("survey")
    region = folder / "roi.gpkg"
    geopandas.GeoDataFrame(geometry=[shapely.Polygon(pair.roi)], crs=pair.crs).to_file(region)
    return write(pair, folder / "survey.las"), region


@pytest.fixture(scope="session")
def result(inputs, tmp_path_factory) -> GroundResult:
    return extract_ground(inputs[0], tmp_path_factory.mktemp("out") / "a_ground.laz", roi=inputs[1], pdal=any_pdal())


def any_pdal() -> Pdal:
    """A PDAL, for tests that compare with it."""
    found = find_pdal()
    if not found.is_there:
        pytest.skip("no PDAL on this machine")
    return found


def old_pdal() -> Pdal:
    """The PDAL at hand, as one whose filters.csf does not work."""
    found = any_pdal()
    return Pdal(found.path, "2.2.0", found.how)


def rows(path: Path) -> set[tuple[float, ...]]:
    """What identifies points, by all that must not change."""
    las = laspy.read(path)
    names = ("gps_time", "X", "Y", "Z", "intensity", "red", "return_number", "user_data")
    return set(zip(*(np.asarray(las[n]).tolist() for n in names), strict=True))

"""A long thin slope whose ground does not fit into a small memory limit in one piece, and its ground both ways."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.ground.extraction import extract_ground
from slopewatch.engine.ground.result import GroundResult
from slopewatch.interface.parameters import GroundParameters, SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair
from slopewatch.tests.builders.extracted_ground import any_pdal, write

LONG = SurveyParameters(seed=5, points=90_000, length=190.0, height=6.0)
SMALL_GB = 0.355
"""Too little for the long slope in one piece, enough for it in tiles."""


@pytest.fixture(scope="session")
def long_pair() -> SimulatedPair:
    return simulate_pair(LONG)


@pytest.fixture(scope="session")
def long_cloud(long_pair, tmp_path_factory) -> Path:
    return write(long_pair, tmp_path_factory.mktemp("long") / "long.las", with_strays)


def with_strays(las) -> None:
    """Three single points far below, and two of a class for noise."""
    las.z[:3] = las.z[:3] - 40.0
    las.classification[10:12] = 7


@pytest.fixture(scope="session")
def in_one_piece(long_cloud, tmp_path_factory) -> GroundResult:
    return extract_ground(long_cloud, tmp_path_factory.mktemp("piece") / "a_ground.laz", pdal=any_pdal())


@pytest.fixture(scope="session")
def in_tiles(long_cloud, tmp_path_factory) -> GroundResult:
    parameters = GroundParameters(ground_memory=SMALL_GB)
    folder = tmp_path_factory.mktemp("tiles")
    return extract_ground(long_cloud, folder / "a_ground.laz", parameters=parameters, pdal=any_pdal())


def slope_points(count: int = 40_000, seed: int = 0) -> np.ndarray:
    """Points (n, 3) of a slope of 30 degrees, 120 x 40 m, turned against the axes, with plants and a few strays."""
    rng = np.random.default_rng(seed)
    u, v = rng.uniform(0, 120, count), rng.uniform(0, 40, count)
    height = np.where(rng.random(count) < 0.4, rng.uniform(0, 2.5, count), rng.normal(0, 0.02, count))
    height[:5] = [-30.0, -30.2, 25.0, 60.0, -90.0]
    xyz = np.column_stack([0.8 * u - 0.6 * v, 0.6 * u + 0.8 * v, 0.577 * v + height])
    return xyz + [-20.0, -35.0, 100.0]

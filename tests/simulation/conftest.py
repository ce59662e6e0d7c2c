"""Small simulated surveys that several tests look at."""

from __future__ import annotations

import pytest
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.surveys.survey import SimulatedPair, simulate_pair

SMALL = SurveyParameters(seed=7, points=60_000, length=24.0, height=10.0, angle=39.0, vegetation=0.6)


@pytest.fixture(scope="session")
def pair() -> SimulatedPair:
    return simulate_pair(SMALL)

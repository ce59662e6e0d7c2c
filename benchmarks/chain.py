"""A simulated pair through ground extraction, registration, differencing and zones, as the engine's flow does it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..engine.change import Change, difference
from ..engine.change_zones import change_zones
from ..engine.ground import ground_mask
from ..engine.parameters import ChangeParameters, GroundParameters, RegistrationParameters
from ..engine.registration import register
from ..engine.registration_result import RegistrationResult
from ..engine.zones import Zones
from ..simulation.survey import SimulatedPair
from .controlled_test import inside

Float = NDArray[np.float64]


def registered(pair: SimulatedPair) -> tuple[RegistrationResult, Float, Float]:
    """The registration at its default settings, and both epochs' ground points (n, 3) and (m, 3), registered."""
    first, second = (
        xyz[ground_mask(xyz, GroundParameters())]
        for xyz in (cloud.xyz[inside(cloud.xyz, pair)] for cloud in (pair.first, pair.second))
    )
    found = register(first, second, RegistrationParameters())
    return found, first, found.transform.apply(second)


def changed(
    found: RegistrationResult, first: Float, second: Float, parameters: ChangeParameters
) -> tuple[Change, Zones]:
    """Change and zones of two registered epochs."""
    change = difference(first, second, parameters, registration_error=found.registration_error)
    return change, change_zones(change)

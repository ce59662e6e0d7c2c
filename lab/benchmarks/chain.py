"""A simulated pair through ground extraction, registration, differencing and zones, as the engine's flow does it."""

from __future__ import annotations

from dataclasses import dataclass

import shapely

from ...engine.change.difference import difference
from ...engine.change.result import Change
from ...engine.core.arrays import Bool, Float
from ...engine.ground.filtering import ground_mask, known_ground
from ...engine.pointcloud.plant_cover import PlantCover
from ...engine.pointcloud.returns import last_returns
from ...engine.registration.register import register
from ...engine.registration.result import RegistrationResult
from ...engine.zones.change_zones import change_zones
from ...engine.zones.extraction import Zones
from ...interface.parameters import ChangeParameters, GroundParameters, RegistrationParameters
from ...simulation.surveys.scanner import SurveyCloud
from ...simulation.surveys.series import SimulatedSeries
from ...simulation.surveys.survey import SimulatedPair


@dataclass(frozen=True)
class Ground:
    """Ground points ``xyz`` (n, 3) of an epoch and the plants over them, None where nothing is known."""

    xyz: Float
    plants: PlantCover | None = None


def inside(xyz: Float, pair: SimulatedPair | SimulatedSeries) -> Bool:
    """Which points (n, 3) lie in the region of interest (a rectangle, turned), as the clip leaves them."""
    polygon = shapely.Polygon(pair.roi)
    shapely.prepare(polygon)
    return shapely.contains_xy(polygon, xyz[:, 0], xyz[:, 1])


def registered_clouds(pair: SimulatedPair, profile: str = "default") -> tuple[Float, Float, float]:
    """Ground (n, 3) of both epochs in the region from all returns, the second registered, and the registration's error
    in metres.
    """
    parameters = GroundParameters.build(profile=profile)
    clouds = [cloud.xyz[inside(cloud.xyz, pair)] for cloud in (pair.first, pair.second)]
    first, second = (xyz[ground_mask(xyz, parameters)] for xyz in clouds)
    found = register(first, second, RegistrationParameters.build(profile=profile))
    return first, found.transform.apply(second), found.registration_error


def ground_of(
    cloud: SurveyCloud, pair: SimulatedPair | SimulatedSeries, parameters: GroundParameters | None = None
) -> Ground:
    """The ground of an epoch within the region, of its last returns as from a file."""
    held = inside(cloud.xyz, pair)
    xyz, last = cloud.xyz[held], last_returns(cloud.return_number[held], cloud.number_of_returns[held]).last
    found = known_ground(xyz, parameters, last)
    return Ground(xyz[found.mask], found.plants)


def registered(
    pair: SimulatedPair,
    ground: GroundParameters | None = None,
    registration: RegistrationParameters | None = None,
) -> tuple[RegistrationResult, Ground, Ground]:
    """The registration and both epochs' ground, registered; at the default settings where none are given."""
    first, second = (ground_of(cloud, pair, ground) for cloud in (pair.first, pair.second))
    parameters = registration or RegistrationParameters()
    found = register(first.xyz, second.xyz, parameters, plants=(first.plants, second.plants))
    return found, first, Ground(found.transform.apply(second.xyz), second.plants)


def changed(
    found: RegistrationResult, first: Ground, second: Ground, parameters: ChangeParameters
) -> tuple[Change, Zones]:
    """Change and zones of two registered epochs."""
    change = difference(
        first.xyz,
        second.xyz,
        parameters,
        registration_error=found.registration_error,
        plants=(first.plants, second.plants),
    )
    return change, change_zones(change)

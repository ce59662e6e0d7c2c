"""Whether two surveys can be compared: reference systems, heights, two clouds and not one twice."""

from __future__ import annotations

import math
from pathlib import Path

from ...interface.parameters import InputParameters, RegistrationParameters
from ..core.errors import InputError
from ..pointcloud.cloud import PointCloud
from ..pointcloud.in_parts import SpooledCloud, every_of
from ..pointcloud.reading import open_cloud, sample_cloud
from .epoch import same_content
from .height_systems import MAX_POINTS, compare_clouds, disagreement

_MAX_PLANT_DROP_M = 5.0  # m that the lowest points of a cell can fall all over a slope by cutting what grows there
_MAX_OFFSET_RATIO = 3.0  # times the largest expected offset: so far away the robust method finds its way back


def require_comparable(first: Path, second: Path, inputs: InputParameters) -> None:
    """Raise InputError unless both clouds can be opened and are in the same reference system, by their headers."""
    systems = [open_cloud(path, inputs, None)[1].crs for path in (first, second)]
    if not systems[0].equals(systems[1], ignore_axis_order=True):
        plans = [system.sub_crs_list[0] if system.is_compound else system for system in systems]
        if plans[0].equals(plans[1], ignore_axis_order=True):
            a, b = (system.sub_crs_list[-1].name if system.is_compound else "none" for system in systems)
            raise InputError(
                f"The epochs declare different height systems: {first.name} {a}, {second.name} {b}; bring both to the "
                "same heights, or if a declaration is wrong or missing give both systems with --crs, such as "
                "EPSG:32651+5773."
            )
        raise InputError(
            f"The epochs are in different reference systems: {first.name} in {systems[0].name}, "
            f"{second.name} in {systems[1].name}; reproject one of them, or give --crs if one is declared wrongly."
        )


def require_two_clouds(reference: Path, moving: Path, *, contents: bool = True) -> None:
    """Raise InputError if the two paths are one file, or with ``contents`` copies of one."""
    if not (reference.is_file() and moving.is_file()):
        return
    if reference.samefile(moving):
        raise InputError(f"{reference} was given as both clouds; give two different ones.")
    if contents and same_content(reference, moving):
        raise InputError(f"{reference} and {moving} are the same cloud; give two different epochs.")


def refuse_other_heights(
    first: PointCloud | SpooledCloud, second: PointCloud | SpooledCloud, limit: float = math.inf
) -> None:
    """Raise InputError where the epochs' heights differ by a unit, or all alike by more than ``limit`` metres."""
    samples = [
        every_of(cloud, max(1, len(cloud) // MAX_POINTS)) if isinstance(cloud, SpooledCloud) else cloud.xyz
        for cloud in (first, second)
    ]
    wrong = disagreement(compare_clouds(*samples), first.path.name, second.path.name, limit)
    if wrong is not None:
        raise InputError(wrong)


def refuse_other_raw_heights(
    first: Path, second: Path, inputs: InputParameters, parameters: RegistrationParameters
) -> None:
    """As ``register_pair`` refuses the ground of two surveys, decided on samples of the raw clouds before all work.

    The lowest points of coarse cells are compared. As plants that are cut lower these too, only what no plant explains
    is refused here, and whatever remains is left to the ground.

    Raises:
        InputError: heights of another system or unit.
    """
    found = compare_clouds(sample_cloud(first, inputs), sample_cloud(second, inputs), lowest=True)
    wrong = disagreement(found, first.name, second.name, max(registered_offset(parameters), _MAX_PLANT_DROP_M))
    if wrong is not None:
        raise InputError(wrong)


def registered_offset(parameters: RegistrationParameters) -> float:
    """The offset of heights (m) up to which a registration finds its way."""
    return parameters.maximum_offset * (_MAX_OFFSET_RATIO if parameters.method == "robust" else 1.0)

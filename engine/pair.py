"""What must hold for two clouds to be compared."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from pyproj import CRS
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from .change import Change
from .clouds import PointCloud, open_cloud, sample_cloud
from .coverage import cell_that_compares, compared_share
from .errors import InputError
from .height_systems import compare_clouds, disagreement
from .parameters import InputParameters, RegistrationParameters
from .progress import Progress
from .registration import RegistrationResult, register
from .roi import read_roi
from .run_record import sha256
from .transform import RigidTransform

_LITTLE_COMPARED = 0.5  # share of the ground
_PLANTS = 5.0  # m that the lowest points of a cell can fall all over a slope by cutting what grows there
_WORTH_TELLING = 1.0  # m² of change that plants explain: less comes by chance where plants end
_FOUND = 3.0  # times the largest expected offset: so far away the robust method finds its way back


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
    if contents and reference.stat().st_size == moving.stat().st_size and sha256(reference) == sha256(moving):
        raise InputError(f"{reference} and {moving} are the same cloud; give two different epochs.")


def stable_area(path: Path | None, crs: CRS, progress: Progress) -> BaseGeometry | None:
    """The polygons known to be stable, in ``crs``."""
    if path is None:
        return None
    area = read_roi(path, crs)
    for note in area.notes:
        progress.warning(note)
    return area.geometry


def common_area(path: Path | None, first: PointCloud, transform: RigidTransform) -> BaseGeometry | None:
    """The region of interest as both epochs hold it: the later cloud was clipped before it was moved."""
    if path is None:
        return None
    area = read_roi(path, first.crs).geometry
    middle = np.array([[area.centroid.x, area.centroid.y, float(np.median(first.xyz[:, 2]))]])
    shift = (transform.apply(middle) - middle)[0]
    return area.intersection(translate(area, shift[0], shift[1]))


def known_stable(path: Path | None, first: PointCloud) -> BaseGeometry | None:
    """The polygons known to be stable as ``change.difference`` takes them."""
    return None if path is None else read_roi(path, first.crs).geometry


def refuse_other_heights(first: PointCloud, second: PointCloud, limit: float = math.inf) -> None:
    """Raise InputError where the epochs' heights differ by a unit, or all alike by more than ``limit`` metres."""
    wrong = disagreement(compare_clouds(first.xyz, second.xyz), first.path.name, second.path.name, limit)
    if wrong is not None:
        raise InputError(wrong)


def refuse_other_raw_heights(
    first: Path, second: Path, inputs: InputParameters, parameters: RegistrationParameters
) -> None:
    """As ``register_pair`` refuses the ground of two surveys, told from samples of the raw clouds before all work.

    The lowest points of coarse cells are compared. As plants that are cut lower these too, only what no plant explains
    is refused here, and whatever remains is left to the ground.

    Raises:
        InputError: heights of another system or unit.
    """
    found = compare_clouds(sample_cloud(first, inputs), sample_cloud(second, inputs), lowest=True)
    wrong = disagreement(found, first.name, second.name, max(_registered(parameters), _PLANTS))
    if wrong is not None:
        raise InputError(wrong)


def _registered(parameters: RegistrationParameters) -> float:
    """The offset of heights (m) up to which a registration finds its way."""
    return parameters.maximum_offset * (_FOUND if parameters.method == "robust" else 1.0)


def register_pair(
    first: PointCloud, second: PointCloud, parameters: RegistrationParameters, stable: Path | None, progress: Progress
) -> RegistrationResult:
    """Register ``second`` to ``first`` (see ``registration.register``) and tell the user its warnings.

    Raises:
        InputError: see ``registration.register``; heights of another system or unit, farther off than is registered.
    """
    refuse_other_heights(first, second, _registered(parameters))
    area = stable_area(stable, first.crs, progress)
    result = register(
        first.xyz, second.xyz, parameters, stable=area, plants=(first.plants, second.plants), progress=progress
    )
    for warning in result.warnings:
        progress.warning(warning)
    return result


def warn_of_doubtful_change(change: Change, progress: Progress, *, may_grow: bool = True) -> None:
    """Name ground that was not compared, and a shift of the whole overlap, for what they are.

    Args:
        may_grow: whether cells that grow can be asked for where this warning is read.
    """
    compared = compared_share(change)
    if compared < _LITTLE_COMPARED:
        remedy = "check that both cover the same slope"
        if change.block is not None:
            remedy += ", or give a larger largest_cell"
        elif larger := cell_that_compares(change):
            growing = ", or cells that grow (adaptive)," if may_grow else ""
            remedy = f"cells of {larger:g} m{growing} would compare most of it"
        progress.warning(
            f"Only {100 * compared:.2g} % of the ground that the surveys reached could be compared; the rest has no "
            f"points of both epochs in a cell, and zones and volumes leave it out; {remedy}."
        )
    for note in change.model.notes:
        progress.warning(note)
    if change.season is not None and change.season.differs:
        progress.warning(change.season.sentence)
    explained = 0.0 if change.explained is None else float(change.explained.sum()) * change.grid.cell**2
    if explained >= _WORTH_TELLING:
        progress.warning(
            f"{explained:.1f} m² of change beyond the level of detection may be "
            "that of the plants, which differ there by as much: it counts in no zone and no volume, and "
            "plant_change.tif shows it; look at the place where it matters."
        )
    shift = change.uniform_dz
    if shift is not None and change.season is not None and change.season.explains(shift):
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m, and the plants "
            "changed alike: most likely the plants, not a deformation; no zones are drawn. Register on bare ground, "
            "such as a road given as stable, or compare surveys of the same season."
        )
    elif shift is not None:
        progress.warning(
            f"The whole overlap has {'risen' if shift > 0 else 'sunk'} by about {abs(shift):.3f} m: a datum or height "
            "bias (such as ellipsoidal against orthometric heights), not a deformation; no zones are drawn. Check the "
            "height systems, or register first."
        )

"""One survey moved onto another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pyproj import CRS

from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.epochs.comparability import refuse_other_heights, registered_offset
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.registration.result import RegistrationResult
from ..engine.registration.surveys import register_surveys
from ..interface.parameters import RegistrationParameters, SurfaceParameters
from ..workflows.given_values import Values
from .given import Area, Cloud, Survey, Surveyed, area_of, ground_survey
from .options import takes
from .shown import heights_picture, points_dataset
from .written import write_survey

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (SurfaceParameters, RegistrationParameters)


@dataclass(frozen=True)
class Registration(Surveyed):
    """A survey as it was moved onto a reference; give it to ``change`` and the others in place of the survey.

    Attributes:
        survey: the moved points.
        result: the motion and how good it is.
        warnings: sentences about what is doubtful.
    """

    survey: Survey
    result: RegistrationResult
    warnings: tuple[str, ...]

    @property
    def transform(self) -> RigidTransform:
        """From the survey as given to the reference; ``transform.matrix`` is 4 by 4."""
        return self.result.transform

    @property
    def error(self) -> float:
        """Standard error of a height after the registration, metres."""
        return self.result.registration_error

    def to_xarray(self) -> xarray.Dataset:
        """The moved points along the dimension ``point``."""
        return points_dataset(self.survey.points)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The moved survey from above, coloured by height."""
        return heights_picture(self.survey.points, ax)

    def write(self, folder: str | Path) -> Path:
        """Write ``aligned.laz`` and ``transform.json`` into a folder, which is made if missing; the latter's path."""
        write_survey(self.survey, Path(folder) / "aligned.laz")
        path = Path(folder) / "transform.json"
        self.transform.save(path, self.survey.points.crs, facts=self.result.stated())
        return path


def pair_of(
    reference: Cloud, moving: Cloud, crs: str | CRS | None, parameters: SurfaceParameters, progress: Progress
) -> tuple[Survey, Survey]:
    """The ground of two surveys that can be compared.

    Raises:
        InputError: as ``given.ground_survey``; the surveys are in different reference systems.
    """
    first, later = (
        ground_survey(given, name, crs, parameters.ground, progress)
        for given, name in ((reference, "reference"), (moving, "moving"))
    )
    refuse_other_systems(first, later)
    return first, later


def refuse_other_systems(first: Survey, later: Survey) -> None:
    """Raise InputError where the surveys are in different reference systems."""
    if not first.points.crs.equals(later.points.crs, ignore_axis_order=True):
        raise InputError(
            f"The surveys are in different reference systems, {first.points.crs.name} and {later.points.crs.name}; "
            "reproject one of them, or give crs."
        )


def registered(
    first: Survey, later: Survey, parameters: RegistrationParameters, stable: Area | None, progress: Progress
) -> Registration:
    """The later survey moved onto the first one.

    Raises:
        InputError: as ``register``.
    """
    known = len(progress.warnings)
    refuse_other_heights(first.points, later.points, registered_offset(parameters))
    result = register_surveys(
        (first.points.xyz, first.points.plants),
        (later.points.xyz, later.points.plants),
        parameters,
        stable=area_of(stable, first.points.crs, "stable"),
        progress=progress,
    )
    for sentence in result.warnings:
        progress.warning(sentence)
    moved = replace(later.points, xyz=result.transform.apply(later.points.xyz))
    return Registration(replace(later, points=moved, registration=result), result, tuple(progress.warnings[known:]))


@takes(*_GROUPS)
def register(
    reference: Cloud,
    moving: Cloud,
    *,
    crs: str | CRS | None = None,
    stable: Area | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> Registration:
    """Move the ground of a later survey onto that of a reference, by what stayed where it was.

    The same as ``slopewatch register``; docs/registration.md says when to trust it.

    Parameters
    ----------
    reference, moving : Ground, array (n, 3), laspy.LasData or path
        The earlier and the later survey.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    stable : shapely geometry, GeoDataFrame or path, optional
        Polygons that are known to have stayed; only they are registered.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    Registration

    Raises
    ------
    InputError
        The surveys cannot be registered, or what stayed cannot be told from what moved.
    """
    progress = progress or Progress()
    values = Values(dict(parameters), _GROUPS)
    pair = pair_of(reference, moving, crs, values.of(SurfaceParameters), progress)
    return registered(*pair, values.of(RegistrationParameters), stable, progress)

"""Registration of two surveys of any size."""

from __future__ import annotations

from dataclasses import replace

from shapely.geometry.base import BaseGeometry

from ...interface.parameters import RegistrationParameters
from ..core.progress import Progress
from .register import register
from .result import RegistrationResult
from .thinned import MAX_POINTS, Survey, evenly_chosen, points_in


def register_surveys(
    first: Survey,
    second: Survey,
    parameters: RegistrationParameters,
    *,
    stable: BaseGeometry | None = None,
    progress: Progress | None = None,
    most: int | None = None,
) -> RegistrationResult:
    """As ``register``, of points in memory or on the disk, each with the plants over them where they are in memory.

    Of surveys with more than ``most`` points, by default ``thinned.MAX_POINTS``, squares that lie evenly over the slope
    are registered.

    Raises:
        InputError: as ``register``.
    """
    progress = progress or Progress()
    squares = evenly_chosen((first[0], second[0]), parameters.maximum_offset, stable, most or MAX_POINTS)
    (reference, of_reference), (moving, of_moving) = (points_in(squares, survey) for survey in (first, second))
    if squares is not None:
        progress.info(
            f"Registered by {len(reference):,} and {len(moving):,} points of {len(squares.taken)} squares of "
            f"{squares.side:g} m, evenly over the slope."
        )
    found = register(reference, moving, parameters, stable=stable, plants=(of_reference, of_moving), progress=progress)
    if squares is None:
        return found
    inliers = round(found.inliers * len(second[0]) / len(moving))
    return replace(found, inliers=inliers, registered_points=(len(reference), len(moving)))

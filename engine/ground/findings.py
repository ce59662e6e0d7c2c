"""What an extraction refuses or warns of by its numbers, the same for a cloud in one piece and in tiles."""

from __future__ import annotations

from dataclasses import dataclass

from ...interface.parameters import GroundParameters
from ..core.errors import InputError
from ..geometry.dominant_plane import Plane
from ..pointcloud.returns import Returns
from .cover import GroundCover
from .result import TilesUsed


@dataclass(frozen=True)
class Outcome:
    """What an extraction found, whatever the way.

    ``points`` of the clipped cloud on ``area`` m², of which ``ground_points`` are ground and ``outliers`` were left
    out; ``method`` laid the cloth. The others as in ``GroundResult``.
    """

    points: int
    area: float
    ground_points: int
    outliers: int
    vegetation_cover: float | None
    spacing: float
    plane: Plane
    scatter: float
    threshold: float
    method: str
    cover: GroundCover | None
    tiles: TilesUsed | None = None


def spacing_warning(name: str, spacing: float, parameters: GroundParameters) -> str:
    """What is wrong with a cloud ``name`` whose points are ``spacing`` m apart; empty where nothing is."""
    if spacing <= parameters.cloth_resolution:
        return ""
    return (
        f"The points of {name} are {spacing:.2f} m apart, farther than the cloth's particles "
        f"({parameters.cloth_resolution:g} m); give a cloth_resolution of about {2 * spacing:.1f} m."
    )


def returns_warning(name: str, returns: Returns, parameters: GroundParameters) -> str:
    """Why all returns of the cloud ``name`` take part where only the last should; empty where these do."""
    if returns.usable or not parameters.last_returns:
        return ""
    return f"All returns of {name} take part in the ground filter: {returns.note}."


def refuse_implausible(name: str, found: int, count: int, parameters: GroundParameters) -> None:
    """Raise InputError if ``found`` of ``count`` points of the cloud ``name`` are too few to be its ground."""
    if found == 0:
        raise InputError(
            f"No ground was found in {name}; check the units of its heights and its region, or give a "
            "larger class_threshold."
        )
    if found < parameters.minimum_ground_ratio * count:
        raise InputError(
            f"Only {found} of {count} points of {name} came out as ground "
            f"({100 * found / count:.2f} %), too few to be true; check the units of its heights and its outliers, "
            "or lower minimum_ground_ratio."
        )

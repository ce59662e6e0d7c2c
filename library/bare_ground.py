"""The ground among the points of a raw survey."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pyproj import CRS
from shapely import contains_xy

from ..engine.core.arrays import Bool
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.ground.points import GroundOfPoints, ground_of_points
from ..engine.pointcloud import plant_cover
from ..engine.pointcloud.returns import Returns
from ..interface.parameters import GroundParameters
from ..workflows.given_values import Values
from .given import Area, Cloud, Survey, Surveyed, area_of, survey_of
from .options import takes
from .shown import heights_picture, points_dataset
from .written import write_survey

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Ground(Surveyed):
    """Ground of a survey.

    Attributes:
        survey: the ground's points, with the plants over them.
        mask: (n,) which of the points given are ground.
        found: how it was found, with cover and scatter.
        warnings: sentences about what is doubtful.
    """

    survey: Survey
    mask: Bool
    found: GroundOfPoints
    warnings: tuple[str, ...]

    @property
    def xyz(self) -> np.ndarray:
        """(m, 3) metres."""
        return self.survey.points.xyz

    def to_xarray(self) -> xarray.Dataset:
        """The points along the dimension ``point``."""
        return points_dataset(self.survey.points)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The ground from above, coloured by height."""
        return heights_picture(self.survey.points, ax)

    def write(self, folder: str | Path) -> Path:
        """Write ``ground.laz`` into a folder, which is made if missing; a laspy cloud keeps its other dimensions."""
        return write_survey(self.survey, Path(folder) / "ground.laz", ground=True)


@takes(GroundParameters)
def ground(
    cloud: Cloud,
    *,
    crs: str | CRS | None = None,
    roi: Area | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> Ground:
    """The ground under the vegetation of a raw survey (Zhang et al. 2016, doi:10.3390/rs8060501, and what follows it).

    The same as ``slopewatch ground`` finds, with flight strips as surveyed.

    Parameters
    ----------
    cloud : array (n, 3), laspy.LasData or path
        All returns, in metres or in the units of the reference system.
    crs : str or pyproj.CRS, optional
        Reference system, where the cloud does not declare it; an array without one has a local grid in metres.
    roi : shapely geometry, GeoDataFrame or path, optional
        Polygons of the managed slope.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    Ground

    Raises
    ------
    InputError
        The cloud cannot be used, or holds no ground; the message is one sentence with the remedy.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    chosen = Values(dict(parameters), (GroundParameters,)).of(GroundParameters)
    survey = survey_of(cloud, "survey", crs, progress)
    area = area_of(roi, survey.points.crs, "roi")
    points, inside = survey.points, np.ones(len(survey), bool)
    if area is not None:
        inside = contains_xy(area, points.xyz[:, 0], points.xyz[:, 1])
        if not inside.any():
            raise InputError("No point lies inside the roi; check it and the reference system.")
    labels = np.zeros(len(survey), np.uint8) if points.classification is None else points.classification
    returns = survey.returns or Returns(np.ones(len(survey), bool), usable=True, mixed=False)
    returns = replace(returns, last=returns.last[inside])
    found = ground_of_points(points.path.name, points.xyz[inside], returns, labels[inside], chosen, progress.warning)
    mask = np.zeros(len(survey), bool)
    mask[np.flatnonzero(inside)[found.mask]] = True
    of_ground = survey.chosen(mask)
    error, height = (found.dimensions.get(name) for name in (plant_cover.ERROR, plant_cover.HEIGHT))
    points = replace(of_ground.points, classification=None, plant_error=error, plant_height=height)
    result = replace(of_ground, points=points, bare=True)
    return Ground(result, mask, found, tuple(progress.warnings[known:]))

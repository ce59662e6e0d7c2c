"""Screening of one survey: what stands above or below the slope around it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS

from ..engine.core.arrays import Float
from ..engine.core.progress import Progress
from ..engine.ground.pdal_pipelines import GROUND
from ..interface.parameters import ScreeningParameters
from ..models.screening.cloud_file import CLASS, PROBABILITY
from ..models.screening.result import Screening
from ..models.screening.screen import chosen_by_class, screen_points
from ..models.screening.zones import Hazards, outline_hazards
from ..workflows.given_values import Values
from ..workflows.products.screening import Pictured, default_targets, write_products
from ..workflows.settings import ScreeningSettings, groups
from .given import Cloud, Survey, survey_of
from .options import takes
from .products import writing
from .shown import raster_dataset, raster_picture
from .written import Dimensions, hash_of, write_survey

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (ScreeningParameters,)
_LABELLED = "screened.laz"


@dataclass(frozen=True)
class _Points:
    """A survey's ground, as ``result.GroundPoints``."""

    survey: Survey
    classified: bool

    @property
    def name(self) -> str:
        return self.survey.points.path.name

    @property
    def bare(self) -> bool:
        return self.survey.bare

    def parts(self) -> Iterator[Float]:
        yield self.survey.points.xyz


@dataclass(frozen=True)
class Screened:
    """A survey that was screened.

    Attributes:
        survey: the points that were screened.
        labels: (n,) 0 background, 1 uplift, 2 subsidence, of each of them.
        probability: (n,) of the label.
        result: the screening itself, hazards as rasters and zones in ``hazards``.
        parameters: what it was made with.
        warnings: sentences about what is doubtful.
    """

    survey: Survey
    labels: NDArray[np.uint8]
    probability: NDArray[np.float32]
    result: Screening
    hazards: Hazards
    day: date | None
    parameters: ScreeningSettings
    warnings: tuple[str, ...]

    @property
    def zones(self) -> gpd.GeoDataFrame:
        """What may be a hazard, the most certain first."""
        return self.hazards.frame

    def to_xarray(self) -> xarray.Dataset:
        """Probabilities, height over the slope's trend and label over y and x."""
        found = self.hazards
        return raster_dataset(
            {
                "uplift": (found.probability[1], "probability of uplift", "1"),
                "subsidence": (found.probability[2], "probability of subsidence", "1"),
                "height": (found.heights, "height over the slope's trend", "m"),
                "label": (found.labels, "0 background, 1 uplift, 2 subsidence", "1"),
            },
            found.grid,
            self.survey.points.crs,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Heights over the slope's trend from above, with the outlines of the zones."""
        heights = self.hazards.heights.astype(np.float64)
        limit = float(np.nanpercentile(np.abs(heights), 98)) or 1.0
        chosen = raster_picture(heights, self.hazards.grid, "Height over the trend (m)", limit, ax)
        if len(self.zones):
            self.zones.boundary.plot(ax=chosen, color="black", linewidth=0.8, aspect=None)
        return chosen

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Mapping[str, Path]:
        """Write what ``slopewatch screen`` writes: ``screened.laz``, zones, probabilities, map; the paths by name."""
        place = Path(folder).absolute()
        targets = default_targets(place / _LABELLED)
        names = [path.name for path in targets.values()]
        with writing(
            "screen",
            place,
            groups(self.parameters, "screening"),
            names,
            {"cloud": self.survey},
            self.warnings,
            overwrite=overwrite,
        ) as run:
            points = self.survey.points
            digest = hash_of(self.survey)
            shown = Pictured(points, digest, self.day, points.path.stem, "")
            write_products(targets, lambda path: run.stage.path(path.name), self.hazards, shown, run)
            dimensions: Dimensions = {CLASS: self.labels, PROBABILITY: self.probability}
            write_survey(self.survey, run.stage.path(_LABELLED), dimensions=dimensions)
            run.facts |= {"method": self.result.method, "model": self.result.model}
            run.outputs |= targets
        return run.outputs


@takes(*_GROUPS)
def screen(
    cloud: Cloud,
    *,
    crs: str | CRS | None = None,
    day: date | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> Screened:
    """Label every point of one survey's ground background, uplift or subsidence (docs/screening.md).

    Parameters
    ----------
    cloud : Ground, array (n, 3), laspy.LasData or path
        The ground of the survey; a raw survey goes through ``ground`` first.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    day : datetime.date, optional
        Of the survey.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    Screened

    Raises
    ------
    InputError
        The cloud is no slope's bare ground, or not dense enough; the message is one sentence with the remedy.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    values = Values(dict(parameters), _GROUPS)
    chosen = values.of(ScreeningParameters)
    survey = survey_of(cloud, "survey", crs, progress)
    labels = survey.points.classification
    if labels is not None and not survey.bare:
        survey = survey.chosen(chosen_by_class(labels, chosen.ground))
        labels = survey.points.classification
    found = screen_points(_Points(survey, labels is not None and bool((labels == GROUND).any())), chosen, progress)
    hazards = outline_hazards(found, survey.points.crs, chosen)
    label, probability = found.at(survey.points.xyz)
    settings = ScreeningSettings(screening=chosen)
    return Screened(
        survey, label, probability, found, hazards, survey.epoch(day).date, settings, tuple(progress.warnings[known:])
    )

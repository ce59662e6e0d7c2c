"""Change of height between two surveys, with what it can be told from, and its zones."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
from pyproj import CRS

from ..engine.change.difference import Areas, listed_difference
from ..engine.change.doubts import warn_of_doubtful_change
from ..engine.change.result import Change
from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.epochs.comparability import refuse_other_heights
from ..engine.epochs.epoch import parse_date
from ..engine.maps.palette import colour_limit
from ..engine.zones.change_zones import change_zones, method_name
from ..engine.zones.extraction import Zones
from ..interface.parameters import AUTO, ChangeParameters, SurfaceParameters, ZoneParameters
from ..workflows.given_values import Values
from ..workflows.settings import Settings
from .given import Area, Cloud, Survey, area_of
from .options import takes
from .registration import pair_of
from .shown import raster_dataset, raster_picture

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (SurfaceParameters, ChangeParameters, ZoneParameters)
Days = tuple[date | None, date | None]


@dataclass(frozen=True)
class ElevationChange:
    """Change of a later survey against a reference.

    Attributes:
        result: change, error, level of detection and decision of each cell.
        surveys: what was compared.
        days: of both surveys, where they are known.
        parameters: what it was made with.
        warnings: sentences about what is doubtful.
    """

    result: Change
    surveys: tuple[Survey, Survey]
    days: Days
    parameters: Settings
    warnings: tuple[str, ...]

    @property
    def crs(self) -> CRS:
        return self.surveys[0].points.crs

    @cached_property
    def _zones(self) -> Zones:
        method = method_name(self.parameters.change, self.result.direction)
        return change_zones(self.result, self.crs, self.parameters.zones, epochs=self.days, method=method)

    @property
    def zones(self) -> gpd.GeoDataFrame:
        """What changed beyond what the measurement can tell from nothing, with volumes and their errors."""
        return self._zones.frame

    def to_xarray(self) -> xarray.Dataset:
        """Change, standard error, level of detection (m) and decision over y and x."""
        whole = self.result.whole()
        return raster_dataset(
            {
                "change": (whole.dz, f"{whole.measure}, later minus earlier", "m"),
                "error": (whole.error, "standard error of the change", "m"),
                "level": (whole.level, f"level of detection at {whole.confidence:.4g} confidence", "m"),
                "significant": (whole.significant, "whether the change is beyond the level", "1"),
            },
            whole.grid,
            self.crs,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The change from above with the outlines of the zones; ground that was not compared stays white."""
        whole = self.result.whole()
        limit = colour_limit(whole.dz[whole.significant], None, level=whole.median_level)
        chosen = raster_picture(whole.dz, whole.grid, f"{whole.measure} (m)", limit, ax)
        if len(self.zones):
            self.zones.boundary.plot(ax=chosen, color="black", linewidth=0.8, aspect=None)
        return chosen

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Mapping[str, Path]:
        """Write what ``slopewatch change`` writes: GeoTIFFs, zones, heatmap, report; the paths by name."""
        products = importlib.import_module(".products", __package__)  # reports need much that nothing else does
        return dict(products.write_change(self, folder, overwrite=overwrite))


def days_of(dates: tuple[str | date | None, str | date | None], surveys: tuple[Survey, Survey]) -> Days:
    """The days of both surveys: as given, else as in their files' names."""
    given = [parse_date(day) if isinstance(day, str) else day for day in dates]
    first, later = (survey.epoch(day).date for survey, day in zip(surveys, given, strict=True))
    if first is not None and later is not None and first >= later:
        raise InputError(f"The days {first} and {later} are not in order; give the earlier survey first.")
    return first, later


@takes(*_GROUPS)
def change(
    reference: Cloud,
    moving: Cloud,
    *,
    crs: str | CRS | None = None,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    stable: Area | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> ElevationChange:
    """Change of height between the ground of two surveys in one frame, later minus earlier (docs/change.md).

    Parameters
    ----------
    reference, moving : Ground, Registration, array (n, 3), laspy.LasData or path
        The earlier and the later survey. With a ``Registration`` its error is in the level of detection.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    dates : pair of datetime.date or YYYY-MM-DD, optional
        Days of the surveys; without them no rates are known.
    stable : shapely geometry, GeoDataFrame or path, optional
        Polygons that are known to have stayed, on which the errors are calibrated.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    ElevationChange

    Raises
    ------
    InputError
        The surveys cannot be compared; the message is one sentence with the remedy.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    values = Values(dict(parameters), _GROUPS)
    settings = Settings(
        surface=values.of(SurfaceParameters), change=values.of(ChangeParameters), zones=values.of(ZoneParameters)
    )
    pair = pair_of(reference, moving, crs, settings.surface, progress)
    first, later = (survey.points for survey in pair)
    refuse_other_heights(first, later)
    registered = pair[1].registration
    if registered is None and settings.change.registration_error == AUTO:
        progress.warning(
            "The registration's error is not known here, so the level of detection covers the scatter of the points "
            "alone; give the registration_error that the registration reported."
        )
    result = listed_difference(
        first.xyz,
        later.xyz,
        settings.change,
        registration_error=0.0 if registered is None else registered.registration_error,
        areas=Areas(stable=area_of(stable, first.crs, "stable")),
        plants=(first.plants, later.plants),
        progress=progress,
    )
    warn_of_doubtful_change(result, progress, may_grow=not settings.change.adaptive)
    return ElevationChange(result, pair, days_of(dates, pair), settings, tuple(progress.warnings[known:]))

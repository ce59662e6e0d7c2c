"""More than two surveys of one slope: zones through time, velocities and alert levels."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
from pyproj import CRS

from ..engine.change.epoch_cells import epoch_cells, epoch_moments
from ..engine.core.errors import EngineError, InputError
from ..engine.core.progress import Progress
from ..engine.core.temporary_folders import temporary_folder
from ..engine.displacement.registered import Registered
from ..engine.epochs.epoch import parse_date
from ..engine.geometry.rigid_transform import RigidTransform
from ..engine.grid.grid import Grid
from ..engine.maps.palette import colour_limit
from ..engine.pointcloud.in_parts import SpooledCloud
from ..engine.series.alerts import AlertLevel, read_alerts
from ..engine.series.analysis import Analysis, analyse
from ..engine.series.comparisons import Cells, GriddedEpoch
from ..engine.series.first_grid import grid_of
from ..engine.series.tables import About, series_frame, zone_frame
from ..interface.parameters import (
    ChangeParameters,
    GridChangeParameters,
    RegistrationParameters,
    SurfaceParameters,
    ZoneParameters,
)
from ..workflows.given_values import Values
from ..workflows.products.series import SERIES_OUTPUTS, series_figures, write_coverage
from ..workflows.series import method_of, series_facts, write_products, zone_facts
from ..workflows.settings import SeriesSettings, groups
from .given import Area, Cloud, Survey, area_of, ground_survey
from .options import takes
from .products import roles_of, writing
from .registration import Registration, refuse_other_systems, registered
from .shown import raster_dataset, raster_picture, stacked
from .written import hash_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (SurfaceParameters, RegistrationParameters, ChangeParameters, ZoneParameters)


@dataclass(frozen=True)
class Series:
    """Surveys of a slope through time.

    Attributes:
        result: changes, zones and their courses.
        about: days, grid and reference system.
        surveys: the surveys as registered to the first, the earliest first.
        alerts: the table of alert levels that was used.
        parameters: what it was made with.
        warnings: sentences about what is doubtful.
    """

    result: Analysis
    about: About
    surveys: tuple[Survey, ...]
    alerts: tuple[AlertLevel, ...]
    parameters: SeriesSettings
    warnings: tuple[str, ...]

    @property
    def zones(self) -> gpd.GeoDataFrame:
        """What moved, the highest alert first, with velocities and volumes and their errors."""
        last = self.result.cumulative[-1]
        return zone_frame(self.result.zones, last.dz, last.height_to, self.about)

    @property
    def course(self) -> gpd.GeoDataFrame:
        """One row a zone and survey."""
        return series_frame(self.result.zones, self.about)

    def to_xarray(self) -> xarray.Dataset:
        """Change since the first survey, its error and its level of detection (m) over day, y and x."""
        every = []
        for day, change in zip(self.about.dates[1:], self.result.cumulative, strict=True):
            values = {
                "change": (change.dz, f"{change.measure} since the first survey", "m"),
                "error": (change.error, "standard error of the change", "m"),
                "level": (change.level, f"level of detection at {change.confidence:.4g} confidence", "m"),
            }
            one = raster_dataset(values, self.about.grid, self.about.crs)
            every.append(one.expand_dims(day=[np.datetime64(day, "ns")]))
        return stacked(every, "day")

    def plot(self, ax: Axes | None = None) -> Axes:
        """The change since the first survey from above, with the outlines of the zones."""
        last, zones = self.result.cumulative[-1], self.zones
        limit = colour_limit(last.dz[last.significant], level=last.median_level)
        chosen = raster_picture(last.dz, self.about.grid, f"{last.measure} since the first survey (m)", limit, ax)
        if len(zones):
            zones.boundary.plot(ax=chosen, color="black", linewidth=0.8, aspect=None)
        return chosen

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Mapping[str, Path]:
        """Write what ``slopewatch series`` writes but its motion along the surface; the paths by name."""
        recorded = groups(self.parameters, "registration", "change", "zones", "series", "details")
        with writing(
            "series",
            folder,
            recorded,
            SERIES_OUTPUTS,
            roles_of(self.surveys, self.about.dates),
            self.warnings,
            overwrite=overwrite,
        ) as run:
            hashes = tuple(hash_of(s) for s in self.surveys)
            about = replace(self.about, run_id=run.run_id(hashes))
            frame, course = write_products(run, self.result, about, self.alerts, hashes, True)
            run.figures = series_figures(frame, self.result.cumulative, self.result.incremental, about)
            write_coverage(run, self.result, about)
            run.figures["dropped_zones"] = self.result.unconfirmed
            moves = {
                day.isoformat(): _transform(survey).matrix
                for day, survey in zip(about.dates, self.surveys, strict=True)
            }
            run.facts |= series_facts(self.result, about, self.alerts, moves, None)
            run.facts |= zone_facts(self.result, about, frame, course)
        return run.outputs


@takes(*_GROUPS)
def series(
    surveys: Mapping[str | date, Cloud],
    *,
    crs: str | CRS | None = None,
    stable: Area | None = None,
    alerts: str | Path | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> Series:
    """Two or more surveys of a slope: what moved, how fast, and how certain that is (docs/alerts.md).

    Each survey is registered to the first, unless it is a ``Registration`` already.

    Parameters
    ----------
    surveys : mapping of day to Ground, Registration, array (n, 3), laspy.LasData or path
        Ground of each survey; days as ``datetime.date`` or ``YYYY-MM-DD``.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    stable : shapely geometry, GeoDataFrame or path, optional
        Polygons that are known to have stayed.
    alerts : path, optional
        Alert table (CSV), if another than the one that comes with SlopeWatch.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    Series

    Raises
    ------
    InputError
        Fewer than two surveys, or some that cannot be compared.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    values = Values(dict(parameters), _GROUPS)
    settings = SeriesSettings(
        registration=values.of(RegistrationParameters),
        change=values.of(ChangeParameters),
        zones=values.of(ZoneParameters),
    )
    days = {parse_date(day) if isinstance(day, str) else day: cloud for day, cloud in surveys.items()}
    dates = tuple(sorted(days))
    if len(dates) < 2:
        raise InputError(f"Surveys of {len(dates)} days were given; a series takes at least two.")
    moved = _registered([days[day] for day in dates], crs, stable, values, progress)
    first = moved[0].points
    grid, _ = grid_of(first.xyz, settings.change, with_plants=first.plants is not None, progress=progress)
    gridded = [_gridded(day, survey, grid, settings.change) for day, survey in zip(dates, moved, strict=True)]
    table, kept = read_alerts(None if alerts is None else Path(alerts)), ExitStack()
    folder = kept.enter_context(temporary_folder("series"))  # for the changes, as long as the result is in use
    area = area_of(stable, first.crs, "stable")
    with progress.stage(0.5, 1.0, "comparing"):
        found = analyse(gridded, grid, (settings.change, settings.zones), table, folder, stable=area, progress=progress)
    about = About(dates, first.crs, grid, method_of(settings.change), "")
    result = Series(found, about, moved, table, settings, tuple(progress.warnings[known:]))
    weakref.finalize(result, kept.close)
    return result


def _registered(
    clouds: Sequence[Cloud], crs: str | CRS | None, stable: Area | None, values: Values, progress: Progress
) -> tuple[Survey, ...]:
    """The surveys in the frame of the first one."""
    surface, parameters = values.of(SurfaceParameters), values.of(RegistrationParameters)
    moved: list[Survey] = []
    for number, cloud in enumerate(clouds):
        with progress.stage(0.5 * number / len(clouds), 0.5 * (number + 1) / len(clouds), "registering"):
            if not number:
                moved.append(ground_survey(cloud, "first", crs, surface.ground, progress))
            elif isinstance(cloud, Registration):
                moved.append(cloud.survey)
            else:
                given = ground_survey(cloud, f"{number + 1}th", crs, surface.ground, progress)
                refuse_other_systems(moved[0], given)
                moved.append(registered(moved[0], given, parameters, stable, progress).survey)
    return tuple(moved)


def _gridded(day: date, survey: Survey, grid: Grid, parameters: GridChangeParameters) -> GriddedEpoch:
    """A registered survey as the analysis takes it."""
    points, known = survey.points, survey.registration

    def load() -> Cells:
        if isinstance(parameters, ChangeParameters) and parameters.grows:
            return epoch_moments(points.xyz, grid, points.plants)
        return epoch_cells(points.xyz, grid, parameters, points.plants)

    return GriddedEpoch(
        epoch=survey.epoch(day),
        transform=_transform(survey),
        registration_error=0.0 if known is None else known.registration_error,
        load=load,
        points=lambda: points.xyz,
        stored=_held_only,
        ground=points.path,
        key="",
        registered=Registered.shift(0.0, 0.0),
        area=None,
        excluded=None,
        facts={},
        made=(),
    )


def _held_only(folder: Path) -> SpooledCloud:
    raise EngineError(f"points in memory are not stored in {folder}")


def _transform(survey: Survey) -> RigidTransform:
    return RigidTransform.identity() if survey.registration is None else survey.registration.transform

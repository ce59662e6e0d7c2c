"""Motion of the surface along itself between two surveys, as vectors and zones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
from pyproj import CRS
from shapely import contains_xy

from ..engine.core.arrays import Bool, Float
from ..engine.core.progress import Progress
from ..engine.core.version import VERSION
from ..engine.displacement.chance import beyond_chance
from ..engine.displacement.displacement import Displacement, measure_displacement
from ..engine.displacement.registered import Registered
from ..engine.epochs.comparability import refuse_other_heights
from ..engine.grid import geotiff
from ..engine.grid.grid import on_grid
from ..engine.report.compose import REPORT
from ..engine.report.motion_facts import motion_facts
from ..interface.parameters import DisplacementParameters, SurfaceParameters, given
from ..workflows.displacement import LEAST_REFUSED_OFFSET_M, warn_of_motion
from ..workflows.given_values import Values
from ..workflows.products.displacement import DISPLACEMENT_OUTPUTS, main_figures, write_products, zones_layer
from ..workflows.settings import DisplacementSettings, groups
from .elevation_change import Days, days_of
from .given import Area, Cloud, Survey, area_of
from .options import takes
from .products import context_of, roles_of, writing
from .registration import pair_of
from .shown import axes_or_new, raster_dataset

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (SurfaceParameters, DisplacementParameters)


@dataclass(frozen=True)
class Motion:
    """Motion of a later survey along the surface of a reference.

    Attributes:
        result: vectors with their errors, and what moves as one.
        registered: the error of the registration, which the vectors' errors hold.
        surveys: what was compared.
        days: of both surveys, where they are known.
        parameters: what it was made with.
        stable_given: whether ground was given as stable.
        warnings: sentences about what is doubtful.
    """

    result: Displacement
    registered: Registered
    surveys: tuple[Survey, Survey]
    days: Days
    parameters: DisplacementSettings
    stable_given: bool
    warnings: tuple[str, ...]

    @property
    def zones(self) -> gpd.GeoDataFrame:
        """What moves as one, with motion, error and area."""
        return zones_layer(self.result, self.surveys[0].points.crs)

    def to_xarray(self) -> xarray.Dataset:
        """Motion east, north and up and its standard errors (m) over y and x, every window's spacing."""
        found, vectors = self.result, self.result.vectors
        errors = np.sqrt(np.einsum("nii->ni", vectors.covariance))
        errors[~vectors.measured] = np.nan
        values = {}
        for k, name in enumerate(("east", "north", "up")):
            values[name] = (on_grid(found.cell, vectors.motion[:, k], found.grid.shape), f"motion {name}", "m")
            error = on_grid(found.cell, errors[:, k], found.grid.shape)
            values[f"error_{name}"] = (error, f"standard error of the motion {name}", "m")
        smallest = on_grid(found.cell, found.smallest, found.grid.shape)
        values["smallest"] = (smallest, "smallest motion that can be told from none", "m")
        return raster_dataset(values, found.grid, self.surveys[0].points.crs)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The vectors that are no chance, from above, with the outlines of what moves as one."""
        chosen, use, vectors = axes_or_new(ax), beyond_chance(self.result), self.result.vectors
        places, motion = vectors.places[use], vectors.motion[use]
        every = vectors.places
        chosen.plot(every[:, 0], every[:, 1], ".", color="0.85", markersize=1)
        if use.any():
            chosen.quiver(places[:, 0], places[:, 1], motion[:, 0], motion[:, 1], angles="xy", color="tab:red")
        if len(self.zones):
            self.zones.boundary.plot(ax=chosen, color="black", linewidth=0.8, aspect=None)
        return chosen

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Mapping[str, Path]:
        """Write what ``slopewatch displacement`` writes: GeoTIFFs, vectors, zones, report; the paths by name."""
        recorded = groups(self.parameters, "surface", "displacement", "road")
        first = self.surveys[0]
        names = (REPORT, *DISPLACEMENT_OUTPUTS)
        with writing(
            "displacement",
            folder,
            recorded,
            names,
            roles_of(self.surveys, self.days),
            self.warnings,
            overwrite=overwrite,
        ) as run:
            context = context_of(run, self.surveys, self.days, "")
            tags = geotiff.raster_tags(
                epochs=self.days,
                translation=None if context.transform is None else context.transform.translation,
                software=f"SlopeWatch {VERSION}",
                input_sha256=" ".join(context.input_hashes),
            )
            run.outputs |= write_products(self.result, first.points.crs, tags, run)
            run.figures = main_figures(self.result) | {"registration_error_known": self.registered.known}
            run.facts["displacement"] = motion_facts(
                self.result, self.parameters.displacement, self.registered, stable_given=self.stable_given
            )
        return run.outputs


@takes(*_GROUPS)
def displacement(
    reference: Cloud,
    moving: Cloud,
    *,
    crs: str | CRS | None = None,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    stable: Area | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> Motion:
    """Motion of the ground along the surface between two surveys in one frame (docs/displacement.md).

    Parameters
    ----------
    reference, moving : Ground, Registration, array (n, 3), laspy.LasData or path
        The earlier and the later survey. Without a ``Registration`` or ``surface_error`` the registration's error is
        not known and taken as 0.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    dates : pair of datetime.date or YYYY-MM-DD, optional
        Days of the surveys.
    stable : shapely geometry, GeoDataFrame or path, optional
        Polygons that are known to have stayed; their motion is taken off all vectors.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        The surveys cannot be compared; the message is one sentence with the remedy.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    values = Values(dict(parameters), _GROUPS)
    chosen = values.of(DisplacementParameters)
    settings = DisplacementSettings(displacement=chosen, surface=values.of(SurfaceParameters))
    pair = pair_of(reference, moving, crs, settings.surface, progress)
    first, later = (survey.points for survey in pair)
    refuse_other_heights(first, later, max(LEAST_REFUSED_OFFSET_M, chosen.largest_motion))
    registered = _registered(pair[1], chosen, progress)
    area = area_of(stable, first.crs, "stable")

    def inside(xy: Float) -> Bool:
        return np.asarray(contains_xy(area, xy[:, 0], xy[:, 1]), dtype=bool)

    found = measure_displacement(first.xyz, later.xyz, chosen, registered, None if area is None else inside, progress)
    warn_of_motion(found, settings, area is not None, progress)
    return Motion(
        found, registered, pair, days_of(dates, pair), settings, area is not None, tuple(progress.warnings[known:])
    )


def _registered(moving: Survey, parameters: DisplacementParameters, progress: Progress) -> Registered:
    """The registration's error: as given, else as it is known, else none with a warning."""
    stated, known = given(parameters.surface_error), moving.registration
    if stated is not None:
        return Registered.shift(stated, stated if known is None else known.registration_error)
    if known is not None and known.covariance is not None:
        return Registered(np.array(known.covariance), np.asarray(known.transform.centre), known=True)
    progress.warning(
        "The registration's error along the surface is not known here and taken as 0, so that the errors are those of "
        "the relief alone; register the surveys first, or give surface_error."
    )
    return Registered.unknown()

"""Distances between two surveys along the surface's normal (M3C2), with their zones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from shapely import prepare

from ..engine.core.errors import InputError
from ..engine.core.progress import Progress
from ..engine.epochs.comparability import refuse_other_heights
from ..engine.m3c2.distances import Distances
from ..engine.m3c2.level import level_facts
from ..engine.m3c2.scales import Scales, choose_scales, overlap_bounds, survey_cores
from ..engine.m3c2.surveys import HeldSurvey
from ..engine.maps.palette import colour_limit
from ..engine.report.compose import REPORT
from ..engine.zones.extraction import Origin
from ..engine.zones.face_zones import FaceZones, face_zones
from ..interface.parameters import DistanceParameters, SurfaceParameters, ZoneParameters, given
from ..workflows.given_values import Values
from ..workflows.m3c2 import METHOD, Known, measured, parse_direction
from ..workflows.m3c2_clouds import MAX_HEIGHT_OFFSET_M
from ..workflows.products.m3c2 import MAPS, dimensions, main_figures, write_maps
from ..workflows.settings import DistanceSettings, groups
from .elevation_change import Days, days_of
from .given import Area, Cloud, Survey, area_of
from .options import takes
from .products import context_of, roles_of, writing
from .registration import pair_of
from .shown import listed_dataset, values_picture
from .written import write_survey

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes

_GROUPS = (SurfaceParameters, DistanceParameters, ZoneParameters)


@dataclass(frozen=True)
class M3C2Distances:
    """Distances of a later survey from a reference at core points.

    Attributes:
        result: distance, level of detection and counts at each core point.
        scales: what it was measured with.
        surveys: what was compared; ``cores`` are the numbers of the reference's points that are core points.
        days: of both surveys, where they are known.
        parameters: what it was made with.
        warnings: sentences about what is doubtful.
    """

    result: Distances
    scales: Scales
    surveys: tuple[Survey, Survey]
    cores: NDArray[np.signedinteger]
    days: Days
    parameters: DistanceSettings
    warnings: tuple[str, ...]

    @property
    def cell(self) -> float:
        """Of the rasters and of the zones' cells on the face, metres."""
        return given(self.parameters.distances.distance_cell) or self.scales.core_spacing

    @cached_property
    def _zones(self) -> FaceZones:
        crs, origin = self.surveys[0].points.crs, Origin(self.days, METHOD, "")
        return face_zones(self.result, self.cell, crs, self.parameters.zones, origin=origin)

    @property
    def zones(self) -> gpd.GeoDataFrame:
        """What changed beyond what the measurement can tell from nothing, with volumes and their errors."""
        return self._zones.zones.frame

    def to_xarray(self) -> xarray.Dataset:
        """Distance and level of detection (m), decision and normal at the core points."""
        found = self.result
        normal = {f"normal_{axis}": (found.normal[:, k], "direction measured in", "1") for k, axis in enumerate("xyz")}
        return listed_dataset(
            {
                "distance": (found.distance, "distance along the normal, later minus earlier", "m"),
                "level": (found.level, f"level of detection at {found.confidence:.4g} confidence", "m"),
                "significant": (found.significant, "whether the distance is beyond the level", "1"),
                "status": (found.status, "0 measured, 1 few points, 2 no points, 3 no normal", "1"),
                **normal,
            },
            found.core,
            self.surveys[0].points.crs,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The distances from above."""
        found, use = self.result, self.result.measured
        limit = colour_limit(found.distance[found.significant], None, level=float(np.median(found.level[use])))
        return values_picture(found.core[use], found.distance[use], "Distance along the normal (m)", limit, ax)

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Mapping[str, Path]:
        """Write what ``slopewatch m3c2`` writes: ``m3c2.laz``, rasters, zones, report; the paths by name."""
        recorded = groups(self.parameters, "surface", "distances", "zones", "details")
        names = ("m3c2.laz", REPORT, *MAPS)
        with writing(
            "m3c2", folder, recorded, names, roles_of(self.surveys, self.days), self.warnings, overwrite=overwrite
        ) as run:
            context = context_of(run, self.surveys, self.days, METHOD)
            cores = self.surveys[0].chosen(self.cores)
            write_survey(cores, run.stage.path("m3c2.laz"), dimensions=dimensions(self.result))
            run.outputs["points"] = run.stage.final("m3c2.laz")
            run.facts["scales"] = vars(self.scales)
            run.facts["level_of_detection"] = level_facts(self.result, calibrate=self.parameters.distances.calibrate)
            run.figures = main_figures(self.result)
            registration = self.surveys[1].registration
            run.facts |= {
                "run_id": context.run_id,
                "registration": {} if registration is None else registration.stated(),
            }
            write_maps(run, self.result, self.cell, context, self.parameters.zones, run.stage.directory)
        return run.outputs


@takes(*_GROUPS)
def m3c2(
    reference: Cloud,
    moving: Cloud,
    *,
    crs: str | CRS | None = None,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    roi: Area | None = None,
    stable: Area | None = None,
    progress: Progress | None = None,
    **parameters: object,
) -> M3C2Distances:
    """Distances of a later survey from a reference along the normal (Lague et al. 2013).

    See doi:10.1016/j.isprsjprs.2013.04.009. It measures where the surface is steep or overhangs.

    Parameters
    ----------
    reference, moving : Ground, Registration, array (n, 3), laspy.LasData or path
        The earlier and the later survey, in one frame.
    crs : str or pyproj.CRS, optional
        As of ``ground``.
    dates : pair of datetime.date or YYYY-MM-DD, optional
        Days of the surveys; without them no rates are known.
    roi : shapely geometry, GeoDataFrame or path, optional
        Polygons outside of which no core point lies.
    stable : shapely geometry, GeoDataFrame or path, optional
        Polygons that are known to have stayed, on which the level is calibrated.
    progress : Progress, optional
        Receives progress and warnings.

    Returns
    -------
    M3C2Distances

    Raises
    ------
    InputError
        The surveys cannot be compared, or no core point can be measured.
    """
    progress = progress or Progress()
    known = len(progress.warnings)
    values = Values(dict(parameters), _GROUPS)
    chosen = values.of(DistanceParameters)
    settings = DistanceSettings(distances=chosen, surface=values.of(SurfaceParameters), zones=values.of(ZoneParameters))
    if chosen.normals == "given":
        raise InputError("normals is 'given', which needs a file of core points; use slopewatch.api.m3c2 for that.")
    pair = pair_of(reference, moving, crs, settings.surface, progress)
    refuse_other_heights(pair[0].points, pair[1].points, MAX_HEIGHT_OFFSET_M)
    first, later = (HeldSurvey(s.points.xyz, None if s.points.plants is None else s.points.plants.error) for s in pair)
    area, registration = area_of(roi, pair[0].points.crs, "roi"), pair[1].registration
    if area is not None:
        prepare(area)
    scales = choose_scales(first, later, chosen, progress, area)
    for sentence in scales.warnings:
        progress.warning(sentence)
    core, number = survey_cores(first, scales.core_spacing, overlap_bounds(first, later), area)
    error = given(chosen.registration_error)
    if error is None:
        error = 0.0 if registration is None else registration.registration_error
        if registration is None:
            progress.warning(
                "The registration's error is not known here and taken as 0, so the level of detection covers the "
                "scatter of the points alone; give the registration_error that the registration reported."
            )
    what = Known(parse_direction(chosen.orientation), error, area_of(stable, pair[0].points.crs, "stable"))
    found = measured((first, later), core, scales, chosen, what, None, progress)
    return M3C2Distances(found, scales, pair, number, days_of(dates, pair), settings, tuple(progress.warnings[known:]))

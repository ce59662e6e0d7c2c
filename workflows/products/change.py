"""From a change to the files a GIS takes: rasters, zones, heatmap, and the main figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np
from pyproj import CRS

from ...engine.change.coverage import Seen, seen
from ...engine.change.result import Change
from ...engine.core.staged_outputs import Stage
from ...engine.core.version import VERSION
from ...engine.elevation_models.model import EPOCHS, SURFACE_BAND
from ...engine.epochs.epoch import Epoch
from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.grid import geotiff
from ...engine.maps import palette, qgis_styles, top_view
from ...engine.maps.heatmap import write_heatmap_png
from ...engine.maps.heatmap_image import Unseen, make_heatmap
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.in_parts import CloudFile
from ...engine.report.facts import change_facts, error_terms
from ...engine.road.locating import PLACED
from ...engine.statistics.layout import Laid
from ...engine.statistics.normal import Z95
from ...engine.statistics.robust import nmad
from ...engine.zones import extraction, fields, gcd_table
from ...engine.zones.change_zones import cells_of, change_zones
from ...engine.zones.movement import MOVEMENTS
from ...engine.zones.not_seen import not_seen_frame
from ...engine.zones.profile_lines import ProfileLine, steepest_lines
from ...engine.zones.profiles import Layers, missed_lines, take_profile, write_profiles
from ...interface.parameters import HeatmapParameters, given
from ...interface.seen import RASTER
from ..run import Run
from ..settings import Settings
from . import zones as zones_module
from .classes import CLASS_OUTPUTS, Compared, write_class_budgets
from .masked_raster import Legend, write_masked_raster
from .seen import write_seen

CHANGE_OUTPUTS = (
    "elevation_change.tif",
    RASTER,
    "level_of_detection.tif",
    "significant_change.tif",
    "zones.gpkg",
    "volumes.csv",
    "heatmap.png",
    "heatmap.tif",
    "top_view.tif",
    "surface_heights.tif",
    "point_counts.tif",
    "report.html",
)
ON_REQUEST = (
    "cell_size.tif", "change_probability.tif", "plant_error.tif", "plant_change.tif", "objects.gpkg", "report.pdf",
    *CLASS_OUTPUTS,
)  # fmt: skip
"""Outputs of a change with some parameters or layers only, of ground that records plants, or of raw clouds."""


@dataclass(frozen=True)
class Context:
    """What the products state about their origin. ``transform`` is None where nothing was registered by SlopeWatch.

    Not ``counted``: of how many points the heights were made is not known. ``several``: there are more comparisons, so
    that the table by class is written with them.
    """

    first: Epoch
    second: Epoch
    crs: CRS
    transform: RigidTransform | None
    input_hashes: tuple[str, ...]
    method: str
    run_id: str
    counted: bool = True
    several: bool = False

    @property
    def dates(self) -> tuple[date | None, date | None]:
        return self.first.date, self.second.date

    def tags(self, median_level: float | None = None) -> dict[str, str]:
        """What every raster states about its origin."""
        return geotiff.raster_tags(
            epochs=self.dates,
            median_level=median_level,
            translation=None if self.transform is None else self.transform.translation,
            software=f"SlopeWatch {VERSION}",
            input_sha256=" ".join(self.input_hashes),
        )


def write_products(
    run: Run,
    change: Change,
    picture: PointCloud | CloudFile | top_view.TopView,
    context: Context,
    settings: Settings,
    lines: Sequence[ProfileLine] = (),
    zones: extraction.Zones | None = None,
) -> None:
    """Write the products of one change; ``run`` gets their paths, the main figures, and the further figures of the
    report.

    Args:
        picture: the cloud that the top view shows (the later epoch with its vegetation), or that view.
        lines: along which profiles are taken, in addition to the steepest ones through the zones.
        zones: of the change, where they are known already.
    """
    progress = run.progress
    tags = context.tags(Z95 * float(np.nanmedian(change.error)))
    progress.update(0.0, "writing rasters")
    limit = palette.colour_limit(
        change.dz[change.significant], given(settings.heatmap.colour_range), level=change.median_level
    )
    run.outputs |= _write_rasters(change, context, tags, limit, run.stage)
    of_slope = seen(change)
    write_seen(run.stage.path(RASTER), of_slope, change.grid, context.crs, tags)
    run.outputs["seen"] = run.stage.final(RASTER)
    progress.update(0.3, "outlining zones")
    found = zones or change_zones(
        change, context.crs, settings.zones, epochs=context.dates, method=context.method, run_id=context.run_id
    )
    found, table = _write_zones(run, change, found, context, of_slope)
    if run.related.classes is not None and not context.several:
        pair = Compared(context.first.name, context.second.name, change, found.correlation)
        write_class_budgets(run, [pair], run.related.classes, context.crs, context.second.date)
    progress.update(0.5, "drawing the heatmap")
    _write_pictures(
        run, change, found, picture, context, settings.heatmap, (limit, tags, Unseen(of_slope.unseen, change.grid))
    )
    progress.update(0.95, "taking profiles")
    facts = change_facts(change, found.frame, (context.first, context.second), context.crs, limit)
    terms = error_terms(change)
    facts["level_of_detection"] = change.level_facts() | ({"terms": terms} if terms else {})
    facts["volumes"] = table.facts()
    facts["seen"] = of_slope.shares()
    if not context.counted:
        del facts["density"]
    if change.season is not None:
        facts["season"] = change.season.facts()
    layers = Layers(
        change.grid,
        change.height_from,
        change.height_to,
        change.dz,
        change.level,
        change.significant & change.valid,
        change.layout,
    )
    files, facts["profiles"] = profile_products(
        layers, found.frame, lines, settings.report.zone_profiles, context.crs, context.second.date, run.stage
    )
    for sentence in missed_lines(facts["profiles"]):
        progress.warning(sentence)
    progress.update(1.0, "taking profiles")
    run.outputs |= files
    run.facts |= facts
    run.figures |= main_figures(change, found.frame, of_slope) | table.figures()
    run.figures |= {"unsure_groups": len(found.unsure), "unsure_area_m2": float(found.unsure["area_m2"].sum())}


def _write_zones(
    run: Run, change: Change, found: extraction.Zones, context: Context, of_slope: Seen
) -> tuple[extraction.Zones, gcd_table.VolumeTable]:
    """Write the zones and the table of volumes; both, the zones with their places on the road."""
    table = gcd_table.volume_table(cells_of(change), change.significant, found.volumes, found.correlation)
    frame = run.reviews.carried_to(found.frame, "zones.gpkg", fields.FIELDS) if run.reviews else found.frame
    frame = run.related.placed(frame, run.progress)
    zones_module.write_zones(
        run.stage.path("zones.gpkg"),
        frame,
        footprints=extraction.footprint_frame(found, change.grid),
        unsure=found.unsure,
        not_seen=not_seen_frame(of_slope, change.grid, context.crs),
        volumes=gcd_table.table_frame(table),
        stamp=context.second.date,
    )
    gcd_table.write_volume_table(run.stage.path("volumes.csv"), table)
    run.outputs |= {"zones": run.stage.final("zones.gpkg"), "volumes": run.stage.final("volumes.csv")}
    if run.related.road is not None:
        # the reviews, which are read from the file, are not the run's own
        found = replace(found, frame=found.frame.assign(**{name: frame[name] for name in PLACED}))
    return found, table


def _write_pictures(
    run: Run,
    change: Change,
    found: extraction.Zones,
    picture: PointCloud | CloudFile | top_view.TopView,
    context: Context,
    parameters: HeatmapParameters,
    look: tuple[float, dict[str, str], Unseen],
) -> None:
    """The top view and the heatmap over it; ``look``: the colours' limit (m), the rasters' tags, what is hatched."""
    limit, tags, unseen = look
    stage = run.stage
    view = picture
    if not isinstance(view, top_view.TopView):
        view = top_view.top_view(view, top_view.top_view_grid(change.grid, parameters.top_view_pixel))
    geotiff.write_rgba(stage.path("top_view.tif"), view.rgba, view.grid, context.crs, tags=tags)
    shown = Laid(change.dz, change.layout), change.significant, change.level
    heatmap = replace(make_heatmap(*shown, change.grid, view, parameters, limit=limit), unseen=unseen)
    names = context.first.name, context.second.name
    write_heatmap_png(stage.path("heatmap.png"), heatmap, zones=found.frame, epochs=names, progress=run.progress)
    geotiff.write_rgba(stage.path("heatmap.tif"), heatmap.rgba, heatmap.grid, context.crs, tags=tags)
    for name, file in (("heatmap", "heatmap.png"), ("heatmap_raster", "heatmap.tif"), ("top_view", "top_view.tif")):
        run.outputs[name] = stage.final(file)


def profile_products(
    layers: Layers,
    zone_frame: gpd.GeoDataFrame,
    lines: Sequence[ProfileLine],
    count: int,
    crs: CRS | None,
    stamp: date | None,
    stage: Stage,
) -> tuple[dict[str, Path], list[dict[str, Any]]]:
    """Profiles along ``lines`` and down the first ``count`` zones: files (none without a line) and their figures."""
    every = (*lines, *steepest_lines(zone_frame, layers.height_to, layers.dz, layers.grid, count, layers.layout))
    if not every:
        return {}, []
    profiles = [take_profile(line, layers) for line in every]
    return write_profiles(profiles, crs, stage, stamp), [p.facts() for p in profiles]


def main_figures(change: Change, found: gpd.GeoDataFrame, of_slope: Seen) -> dict[str, Any]:
    """The figures that a user reads first; lengths in metres, areas in m², volumes in m³."""
    dz = change.dz[change.valid]
    area = change.grid.cell**2
    significant = change.dz[change.significant]
    rest = found[found["kind"] != fields.SLIDING]
    grown: dict[str, Any] = {}
    if change.partition.grown:
        grown["grown_cells"] = change.partition.count
        grown["cell_size_median_m"] = float(np.nanmedian(change.partition.sizes))
    return grown | {
        "common_cell_rate": change.common_cell_rate,
        "common_area_m2": float(change.valid.sum() * area),
        **{f"{name}_share": share for name, share in of_slope.shares().items() if share},
        "overlap_compared_share": of_slope.share_of_both,
        "lod_median_m": change.median_level,
        "confidence": change.confidence,
        "registration_error_m": change.registration_error,
        "dz_median_m": float(np.median(dz)),
        "dz_nmad_m": nmad(dz),
        "significant_area_m2": float(significant.size * area),
        **zones_module.zone_figures(found),
        "vol_loss_m3": float(found["vol_loss_m3"].sum()),
        "vol_gain_m3": float(found["vol_gain_m3"].sum()),
        "largest_sink_m": float(min(rest["dz_min_m"].min(), 0.0)) if len(rest) else 0.0,
        "largest_rise_m": float(max(rest["dz_max_m"].max(), 0.0)) if len(rest) else 0.0,
        **_movement_figures(found),
        **plant_figures(change),
    }


def _movement_figures(found: gpd.GeoDataFrame) -> dict[str, Any]:
    """How many zones did what; empty where that was not asked for."""
    if not (found["movement"] != "").any():
        return {}
    slid = found[found["kind"] == fields.SLIDING]
    figures: dict[str, Any] = {f"{name}_zones": int((found["movement"] == name).sum()) for name in MOVEMENTS}
    if len(slid):
        fastest = slid.loc[slid["motion_m"].idxmax()]
        figures |= {"sliding_area_m2": float(slid["area_m2"].sum())}
        figures |= {
            "largest_slide_m": float(fastest["motion_m"]),
            "largest_slide_err_m": float(fastest["motion_err_m"]),
        }
    return figures


def plant_figures(change: Change) -> dict[str, Any]:
    """Figures of the error and of the change by plants; empty where plants are not known."""
    if change.plants is None:
        return {}
    figures: dict[str, Any] = {"plant_error_median_m": float(np.median(change.plants.error[change.valid]))}
    if terms := error_terms(change):
        figures["plant_error_largest_share"] = terms[-1]["largest_share"]
    if change.explained is not None:
        figures["plant_change_area_m2"] = float(change.explained.sum() * change.grid.cell**2)
    return figures


def _level_in_words(change: Change) -> str:
    if change.threshold == "constant":
        return "Level of detection, as given"
    of = ", of the errors stated for both surveys" if change.threshold == "propagated" else ""
    return f"Level of detection, {change.confidence:.4g} confidence{of}"


def _write_rasters(
    change: Change, context: Context, tags: dict[str, str], limit: float, stage: Stage
) -> dict[str, Path]:
    path, crs = stage.path("elevation_change.tif"), context.crs
    legend = Legend(f"{change.measure}, later minus earlier", limit)
    write_masked_raster(path, Laid(change.dz, change.layout), change.significant, change.grid, crs, legend, tags)
    outputs = {"elevation_change": stage.final(path.name)}
    layers = [
        (
            "level_of_detection",
            change.level,
            _level_in_words(change),
            qgis_styles.level_qml(float(np.nanpercentile(change.level, 98))),
        ),
        (
            "significant_change",
            np.where(change.significant, change.dz, np.nan),
            f"{change.measure} beyond the level of detection",
            qgis_styles.change_qml(limit, only_beyond=True),
        ),
    ]
    if change.partition.grown:
        sizes = change.partition.sizes
        qml = qgis_styles.cell_size_qml(np.unique(sizes[change.valid]).tolist())
        layers.append(("cell_size", sizes, "Side of the grown cell", qml))
    if change.plants is not None:
        by_plants = np.where(change.valid, change.plants.error, np.nan)
        qml = qgis_styles.level_qml(max(float(np.nanpercentile(by_plants, 98)), 0.01))
        layers.append(("plant_error", by_plants, "Standard error of the change by plants", qml))
    if change.explained is not None and change.explained.any():
        layers.append(
            (
                "plant_change",
                np.where(change.explained, change.dz, np.nan),
                f"{change.measure} beyond the level of detection that the plants explain",
                qgis_styles.change_qml(limit),
            )
        )
    if change.probability is not None:
        words = "Probability that the change is real, from the cell and those around it"
        layers.append(("change_probability", change.probability, words, qgis_styles.probability_qml()))
    for name, array, description, qml in layers:
        path = stage.path(f"{name}.tif")
        unit = "1" if name == "change_probability" else "m"
        held = Laid(array, change.layout)
        geotiff.write_raster(path, held, change.grid, crs, description=description, unit=unit, tags=tags)
        qgis_styles.write_qml_next_to(path, qml)
        outputs[name] = stage.final(path.name)
    return outputs | _write_surfaces(change, context, tags, stage)


def _write_surfaces(change: Change, context: Context, tags: dict[str, str], stage: Stage) -> dict[str, Path]:
    """Heights of both surfaces, and the points behind them where these are counted."""
    outputs = {}
    bands = {
        "surface_heights": (SURFACE_BAND, "m", (change.height_from, change.height_to)),
        "point_counts": ("Ground points a cell, {}", "points", change.points),
    }
    if not context.counted:
        del bands["point_counts"]
    for name, (description, unit, arrays) in bands.items():
        path = stage.path(f"{name}.tif")
        pair = [Laid(np.asarray(array), change.layout) for array in arrays]
        named = {description.format(epoch): band for epoch, band in zip(EPOCHS, pair, strict=True)}
        geotiff.write_bands(path, named, change.grid, context.crs, unit=unit, tags=tags)
        outputs[name] = stage.final(path.name)
    return outputs

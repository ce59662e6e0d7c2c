"""The files that screening writes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from ...engine.core.version import VERSION
from ...engine.grid import geotiff as rasters
from ...engine.maps import qgis_styles as styles
from ...engine.maps.top_view import top_view, top_view_grid
from ...engine.pointcloud.cloud import PointCloud
from ...engine.pointcloud.in_parts import CloudFile
from ...engine.vector import geopackage as vectors
from ...engine.vector.review_fields import own_columns
from ...engine.zones.confirmation import FIELDS as CONFIRMATION_FIELDS
from ...models.screening.cloud_file import CLASS, ScreenedFile
from ...models.screening.map import write_hazard_map
from ...models.screening.result import Screening
from ...models.screening.self_test import SelfTest
from ...models.screening.zones import FIELDS, Hazards
from ..run import Run


def default_targets(
    output: Path,
    zones: Path | None = None,
    probability: Path | None = None,
    picture: Path | None = None,
    smallest: Path | None = None,
) -> dict[str, Path]:
    """Where the outputs go: those not given lie next to the labelled cloud NAME.laz as NAME_zones.gpkg and so on."""
    return {
        "labelled": output,
        "zones": zones or output.with_name(f"{output.stem}_zones.gpkg"),
        "probability": probability or output.with_name(f"{output.stem}_probability.tif"),
        "smallest_hazard": smallest or output.with_name(f"{output.stem}_smallest_hazard.tif"),
        "map": picture or output.with_name(f"{output.stem}_map.png"),
    }


@dataclass(frozen=True)
class Pictured:
    """The survey that was screened, as the products show it.

    ``cloud`` is what the map's top view shows, ``digest`` the SHA-256 of the screened file, ``survey`` its day,
    ``name`` the survey's on the map, ``note`` a sentence more below the map.
    """

    cloud: PointCloud | CloudFile
    digest: str
    survey: date | None
    name: str
    note: str = ""


def write_products(
    targets: dict[str, Path],
    place: Callable[[Path], Path],
    hazards: Hazards,
    shown: Pictured,
    run: Run,
) -> None:
    """Write zones, probabilities, smallest hazards and map of a screening, and the style of its labelled cloud.

    Args:
        targets: as of ``default_targets``; ``place`` gives the path at which the file of a target is to be written now.
        run: holds what people entered in the zones of an earlier run, which the new ones get, and the road.
    """
    known = (*FIELDS, *CONFIRMATION_FIELDS)
    frame = hazards.frame
    if run.reviews is not None:
        frame = run.reviews.carried_to(frame, targets["zones"].name, known)
    frame = run.related.placed(frame, run.progress, "screened zones")
    qml = styles.hazards_qml((name for name in frame.columns if name in known), located=run.related.road is not None)
    layer = vectors.Layer(frame, "zones", qml, "MultiPolygon", own_columns(frame, known), guarded=True)
    vectors.write_layers(place(targets["zones"]), [layer], stamp=shown.survey)
    path = place(targets["probability"])
    up, down = hazards.probability[1], hazards.probability[2]
    bands = {"Probability of a hazard": up + down, "Probability of uplift": up, "Probability of subsidence": down}
    tags = rasters.raster_tags(epochs=(None, shown.survey), software=f"SlopeWatch {VERSION}", input_sha256=shown.digest)
    rasters.write_bands(path, bands, hazards.grid, shown.cloud.crs, unit="1", tags=tags)
    styles.write_qml_next_to(path, styles.probability_qml())
    path = place(targets["smallest_hazard"])
    bands = {f"Height that a hazard {width:g} m wide needs": heights for width, heights in hazards.smallest.items()}
    rasters.write_bands(path, bands, hazards.grid, shown.cloud.crs, tags=tags)
    styles.write_qml_next_to(path, styles.smallest_hazard_qml())
    styles.write_qml_next_to(place(targets["labelled"]), styles.labelled_points_qml(CLASS))
    view = top_view(shown.cloud, top_view_grid(hazards.grid, hazards.grid.cell))
    write_hazard_map(place(targets["map"]), hazards, view, run.progress, name=shown.name, note=shown.note)


def screening_facts(source: ScreenedFile, screening: Screening, tested: SelfTest | None) -> dict[str, str]:
    """Sentences for the record: what can be found on the slope, why no zones are shown where none are, and what the
    self-test found; the last is reported, too.
    """
    facts = {"detectable": screening.detectable.sentence()}
    if screening.hidden:
        facts["not_shown"] = screening.detectable.hidden_sentence(source.name)
    if tested is not None:
        facts["self_test"] = tested.sentence()
        source.progress.info(facts["self_test"])
    return facts


def screening_figures(
    source: ScreenedFile, screening: Screening, hazards: Hazards, labelled: dict[str, int], tested: SelfTest | None
) -> dict[str, Any]:
    """The figures that a user reads first; ``labelled`` as ``ScreenedFile.write_labelled`` returns it."""
    frame = hazards.frame
    return {
        "points": source.header.count,
        "ground_points": screening.ground_points,
        "uplift_points": labelled["uplift"],
        "subsidence_points": labelled["subsidence"],
        "zone_count": len(frame),
        "zone_area_m2": float(frame["area_m2"].sum()),
        "uplift_zones": int((frame["kind"] == "uplift").sum()),
        "subsidence_zones": int((frame["kind"] == "subsidence").sum()),
        "screened_area_m2": float(np.isfinite(hazards.heights).sum() * hazards.grid.cell**2),
        "dip": screening.suitability.dip,
        "dip_direction": screening.plane.azimuth,
        "density": screening.suitability.density,
        **screening.detectable.figures(),
        **({} if tested is None else {"self_test": tested.figures()}),
    }

"""What appeared or vanished above the ground, as a layer of its own and in the run's figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import geopandas as gpd
import numpy as np

from ...engine.geometry.rigid_transform import RigidTransform
from ...engine.grid.geotiff import open_any_grid
from ...engine.maps.qgis_styles import objects_qml
from ...engine.objects.find import find_groups
from ...engine.objects.kinds import VEGETATION
from ...engine.objects.survey import read_survey
from ...engine.objects.table import Origin, object_figures, objects_frame
from ...engine.vector.geopackage import Layer, read_layer, write_layers
from ...interface.parameters import InputParameters
from ...interface.seen import EXCLUDED, RASTER
from ..run import Run
from .change import Context

OBJECTS = "objects.gpkg"
_NUMBERS = ("height_m", "length_m", "width_m", "volume_m3", "volume_low_m3", "volume_high_m3") + (
    "n_points", "confidence", "deposit",
)  # fmt: skip
_WORDS = ("object_id", "kind", "change", "zone_id")
_MOST_RECORDED = 200


@dataclass(frozen=True)
class Classified:
    """Both clouds with all their returns and class 2 for ground; ``transform`` moves the later one."""

    first: Path
    later: Path
    transform: RigidTransform | None
    inputs: InputParameters | None = None


def write_objects(run: Run, clouds: Classified, context: Context) -> None:
    """Write ``objects.gpkg``; the zones and ``seen.tif`` of the run are written already."""
    with run.step("objects", 0.99, 0.99, "comparing what stands above the ground") as entry:
        first = read_survey(clouds.first, inputs=clouds.inputs)
        later = read_survey(clouds.later, clouds.transform, clouds.inputs)
        zones = read_layer(run.stage.path("zones.gpkg"), "zones")
        origin = Origin(context.crs, context.dates, context.run_id)
        frame = _compared(objects_frame(find_groups(first, later), zones, origin), run.stage.path(RASTER))
        path = run.stage.path(OBJECTS)
        style = objects_qml(set(zip(frame["kind"], frame["change"], strict=True)))
        write_layers(path, [Layer(frame, "objects", style, "MultiPolygon")], stamp=context.second.date)
        run.outputs["objects"] = run.stage.final(OBJECTS)
        figures = object_figures(frame)
        run.figures |= figures
        run.facts["objects"] = _recorded(frame)
        entry |= figures


def _compared(frame: gpd.GeoDataFrame, seen: Path) -> gpd.GeoDataFrame:
    """The objects whose middle does not lie where people excluded the slope from the comparison."""
    middles = frame.geometry.representative_point()
    with open_any_grid(seen) as source:
        classes = np.array(
            [value[0] for value in source.sample(zip(middles.x, middles.y, strict=True))], dtype=np.uint8
        )
    return frame[classes != EXCLUDED]


def _recorded(frame: gpd.GeoDataFrame) -> list[dict[str, Any]]:
    """All that is not vegetation, for the report."""
    rows = []
    for row in frame[frame["kind"] != VEGETATION].head(_MOST_RECORDED).to_dict("records"):
        point = row["geometry"].representative_point()
        words, numbers = ({name: row[name] for name in names} for names in (_WORDS, _NUMBERS))
        rows.append(words | {name: round(float(value), 3) for name, value in numbers.items()} | _place(point))
    return rows


def _place(point: Any) -> dict[str, float]:
    return {"x": round(float(point.x), 2), "y": round(float(point.y), 2)}

"""Top views, regions, places on roads, and Label Studio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import (
    InputParameters,
    LabellingParameters,
    RegionParameters,
    RoadParameters,
    TopViewParameters,
    command_sets,
)
from ..workflows.given_values import Values
from ..workflows.labelstudio import export_step, import_step
from ..workflows.locate import locate_step
from ..workflows.suggestroi import suggestroi_step
from ..workflows.topview import topview_step
from .given import PathLike, layers, paths


def top_view(
    cloud: PathLike,
    output_dir: PathLike,
    *,
    roi: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """A raw survey from above as rasters to draw on, as ``slopewatch topview``; see ``inspect`` for the arguments."""
    values = Values(parameters, command_sets.TOPVIEW)
    return topview_step(
        Path(cloud),
        Path(output_dir),
        values.of(TopViewParameters),
        values.of(InputParameters),
        **paths(roi=roi),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def suggest_roi(cloud: PathLike, output: PathLike, *, progress: Progress | None = None, **parameters: Any) -> RunResult:
    """Propose a region of interest, as ``slopewatch suggestroi``; ``output`` is a GeoPackage."""
    values = Values(parameters, command_sets.SUGGESTROI)
    return suggestroi_step(
        Path(cloud),
        Path(output),
        values.of(RegionParameters),
        values.of(InputParameters),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def locate(
    layer: PathLike,
    output: PathLike,
    centreline: PathLike,
    *,
    layer_name: str = "",
    field_names: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Route, chainage, side and offset of the features of a layer, as ``slopewatch locate``.

    ``output`` is a GeoPackage; ``layer_name`` names the layer of a file with several.
    """
    values = Values(parameters, command_sets.LOCATE)
    return locate_step(
        Path(layer),
        Path(output),
        layers(centreline, field_names),
        values.of(RoadParameters),
        layer=layer_name,
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def export_label_studio(
    picture: PathLike,
    output_dir: PathLike,
    *,
    segments: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """A raster of a top view as pictures and tasks for Label Studio, as ``slopewatch exportlabelstudio``.

    ``segments`` are polygons that are shown on the pictures.
    """
    values = Values(parameters, command_sets.EXPORTLABELSTUDIO)
    return export_step(
        Path(picture),
        Path(output_dir),
        values.of(LabellingParameters),
        **paths(segments=segments),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def import_label_studio(
    export: PathLike,
    tasks: PathLike,
    output: PathLike,
    *,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """A JSON export of Label Studio as a layer in a GeoPackage, as ``slopewatch importlabelstudio``."""
    values = Values(parameters, command_sets.IMPORTLABELSTUDIO)
    return import_step(
        Path(export), Path(tasks), Path(output), overwrite=values.overwrite, progress=progress or Progress()
    )

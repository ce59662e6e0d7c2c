"""The public Python API: the commands of SlopeWatch as functions. Only the names in ``__all__`` are promised.

Each function takes paths, writes the files of the command of that name, and returns their paths and the figures.
Parameters are the options of the command line with underscores (``cell=0.2``, ``cloth_resolution=0.3``,
``screen_last_epoch=False``); docs/guide.md explains them. An unknown name is refused.

Examples
--------
>>> from slopewatch import api
>>> run = api.inspect({"2024-05-01": "may24.laz", "2025-05-01": "may25.laz"}, "results", roi="slope.gpkg")
>>> run.outputs["zones"], run.figures["zone_count"]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from .engine.core.errors import Cancelled, EngineError, InputError, SlopeWatchError
from .engine.core.progress import Progress
from .engine.core.run_result import RunResult
from .engine.epochs.epoch import Epoch, parse_date
from .interface.dates import date_in_name
from .interface.parameters import (
    CreepParameters,
    InputParameters,
    LabellingParameters,
    OutputParameters,
    RegionParameters,
    SurveyParameters,
    TopViewParameters,
    command_sets,
)
from .workflows.change import change_step
from .workflows.given_values import Values
from .workflows.ground import ground_step
from .workflows.inspect import inspect_slope
from .workflows.labelstudio import export_step, import_step
from .workflows.m3c2 import m3c2_step
from .workflows.products.screening import default_targets
from .workflows.register import register_step
from .workflows.screen import screen_step
from .workflows.series import monitor_series
from .workflows.settings import DistanceSettings, ScreeningSettings, SeriesSettings, Settings, gathered
from .workflows.simulate import series_step, survey_step
from .workflows.suggestroi import suggestroi_step
from .workflows.topview import topview_step

__all__ = [
    "Cancelled",
    "EngineError",
    "InputError",
    "Progress",
    "RunResult",
    "SlopeWatchError",
    "change",
    "export_label_studio",
    "extract_ground",
    "import_label_studio",
    "inspect",
    "m3c2",
    "monitor",
    "register",
    "screen",
    "simulate",
    "suggest_roi",
    "top_view",
]

PathLike = str | Path


def _paths(**paths: PathLike | None) -> dict[str, Any]:
    return {name: None if path is None else Path(path) for name, path in paths.items()}


def _epochs(surveys: Mapping[str | date, PathLike] | Sequence[PathLike]) -> list[Epoch]:
    """Surveys with their days: the keys of a mapping, or for a sequence the dates in the file names."""
    if isinstance(surveys, Mapping):
        return [Epoch(Path(p), d if isinstance(d, date) else parse_date(d)) for d, p in surveys.items()]
    return [Epoch(Path(p), date_in_name(Path(p))) for p in surveys]


def _day(given: str | date | None) -> str | None:
    return given.isoformat() if isinstance(given, date) else given


def inspect(
    surveys: Mapping[str | date, PathLike] | Sequence[PathLike],
    output_dir: PathLike,
    *,
    roi: PathLike | None = None,
    stable: PathLike | None = None,
    profiles: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """The whole flow: ground of one or two raw surveys, change, zones, heatmap, screening and report.

    Parameters
    ----------
    surveys : mapping of day to path, or sequence of paths
        The earlier survey first; days as ``datetime.date`` or ``YYYY-MM-DD``. For a sequence they come from the names.
    output_dir : path
        Folder for the outputs; created if missing.
    roi, stable, profiles : path, optional
        Vector files: the managed slope, ground known to be stable, lines of profiles.
    pdal : path, optional
        The pdal program, if not the one that is found.
    progress : Progress, optional
        Receives progress and warnings; a subclass can show them.
    **parameters
        As of ``slopewatch inspect``; also ``profile``, ``overwrite`` and ``settings``, the path of a former run's
        ``run.json`` or of a JSON or TOML file, whose values the others override.

    Returns
    -------
    RunResult

    Raises
    ------
    InputError
        Something given cannot be used; the message is one sentence with the remedy.
    EngineError
        The engine itself failed.
    """
    values = Values(parameters, command_sets.INSPECT)
    return inspect_slope(
        _epochs(surveys),
        Path(output_dir),
        gathered(Settings, values.of),
        **_paths(roi=roi, stable=stable, profiles=profiles, pdal=pdal),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def extract_ground(
    cloud: PathLike,
    output: PathLike,
    *,
    roi: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """The ground points of a raw survey, as ``slopewatch ground``; see ``inspect`` for the arguments.

    ``output`` is the LAS or LAZ file of the ground; its folder must exist.
    """
    values = Values(parameters, command_sets.GROUND)
    return ground_step(
        Path(cloud),
        Path(output),
        gathered(Settings, values.of),
        **_paths(roi=roi, pdal=pdal),
        progress=progress or Progress(),
    )


def register(
    reference: PathLike,
    moving: PathLike,
    output: PathLike,
    *,
    transform: PathLike | None = None,
    apply: PathLike | None = None,
    invert: bool = False,
    stable: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Move the ground cloud ``moving`` into the frame of ``reference``, as ``slopewatch register``.

    ``transform`` is where the motion is written. ``apply`` is a motion to apply instead of registering, ``invert`` its
    inverse.
    """
    values = Values(parameters, command_sets.REGISTER)
    return register_step(
        Path(reference),
        Path(moving),
        Path(output),
        gathered(Settings, values.of),
        **_paths(transform_path=transform, given=apply, stable=stable),
        invert=invert,
        progress=progress or Progress(),
    )


def change(
    reference: PathLike,
    moving: PathLike,
    output_dir: PathLike,
    *,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    transform: PathLike | None = None,
    stable: PathLike | None = None,
    profiles: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Elevation change of two registered ground clouds, moving minus reference, as ``slopewatch change``.

    ``dates`` are the days of the surveys; what is None comes from the file's name. ``transform`` is applied to
    ``moving`` first.
    """
    values = Values(parameters, command_sets.CHANGE)
    return change_step(
        Path(reference),
        Path(moving),
        Path(output_dir),
        gathered(Settings, values.of),
        dates=(_day(dates[0]), _day(dates[1])),
        **_paths(transform_path=transform, profiles=profiles, stable=stable),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def m3c2(
    reference: PathLike,
    moving: PathLike,
    output: PathLike,
    *,
    raster_dir: PathLike | None = None,
    core: PathLike | None = None,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    transform: PathLike | None = None,
    stable: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Distances along normals between two registered ground clouds, as ``slopewatch m3c2``.

    ``raster_dir`` is the folder of the rasters, that of ``output`` by default; ``core`` a cloud of the points to
    measure at. ``stable`` are polygons of stable ground, on which the level of detection is calibrated.
    """
    values = Values(parameters, (*command_sets.M3C2, OutputParameters))
    return m3c2_step(
        Path(reference),
        Path(moving),
        Path(output),
        gathered(DistanceSettings, values.of),
        **_paths(raster_dir=raster_dir, core=core, transform_path=transform, stable=stable),
        dates=(_day(dates[0]), _day(dates[1])),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def screen(
    cloud: PathLike,
    output: PathLike,
    *,
    roi: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Label every point of one survey's ground background, uplift or subsidence, as ``slopewatch screen``.

    ``output`` is the labelled cloud (.laz); zones, probabilities and map are written next to it. Needs torch with
    ``screening_method="network"`` and on a GPU only.
    """
    values = Values(parameters, command_sets.SCREEN)
    return screen_step(
        Path(cloud),
        default_targets(Path(output)),
        gathered(ScreeningSettings, values.of),
        **_paths(roi=roi, pdal=pdal),
        progress=progress or Progress(),
    )


def monitor(
    surveys: Mapping[str | date, PathLike] | Sequence[PathLike],
    output_dir: PathLike,
    *,
    roi: PathLike | None = None,
    stable: PathLike | None = None,
    alerts: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Two or more surveys of a slope through time, as ``slopewatch series``; see ``inspect`` for the arguments.

    ``alerts`` is an alert table (CSV) instead of the one that comes with SlopeWatch.
    """
    values = Values(parameters, command_sets.SERIES)
    return monitor_series(
        _epochs(surveys),
        Path(output_dir),
        gathered(SeriesSettings, values.of),
        **_paths(roi=roi, stable=stable, alerts=alerts, pdal=pdal),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


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
        **_paths(roi=roi),
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
        **_paths(segments=segments),
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


def simulate(
    output_dir: PathLike, *, series: bool = False, progress: Progress | None = None, **parameters: Any
) -> RunResult:
    """Surveys with known truth, as ``slopewatch simulate survey``, or a ``series`` of them."""
    values = Values(parameters, command_sets.SIMULATE_SERIES if series else command_sets.SIMULATE_SURVEY)
    folder, report = Path(output_dir), progress or Progress()
    if series:
        return series_step(values.of(CreepParameters), folder, report, overwrite=values.overwrite)
    return survey_step(values.of(SurveyParameters), folder, report, overwrite=values.overwrite)

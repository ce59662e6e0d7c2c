"""From raw surveys on: the whole flow, a series, a corridor, the ground and the screening of one survey."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import BatchParameters, command_sets
from ..workflows.batch.corridor import run_batch
from ..workflows.batch.corridor_plan import Given
from ..workflows.batch.planning import Common
from ..workflows.batch.settings import specifications
from ..workflows.given_values import Values
from ..workflows.ground import ground_step
from ..workflows.inspect import inspect_slope
from ..workflows.products.screening import default_targets
from ..workflows.screen import screen_step
from ..workflows.series import monitor_series
from ..workflows.settings import ScreeningSettings, SeriesSettings, Settings, gathered
from .given import PathLike, epochs, layers, paths


def inspect(
    surveys: Mapping[str | date, PathLike] | Sequence[PathLike],
    output_dir: PathLike,
    *,
    roi: PathLike | None = None,
    stable: PathLike | None = None,
    profiles: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    classes: PathLike | None = None,
    corrections: PathLike | None = None,
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
    centreline, classes : path, optional
        Vector files: the road's axis, along which zones are placed; polygons of classes of asset.
    corrections : path, optional
        Vector file whose polygons exclude areas, or force or forbid ground (field ``action``).
    field_names : path, optional
        JSON or CSV file with an agency's names of the centreline's fields.
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
        epochs(surveys),
        Path(output_dir),
        gathered(Settings, values.of),
        **paths(roi=roi, stable=stable, profiles=profiles, pdal=pdal),
        layers=layers(centreline, field_names, classes, corrections),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def monitor(
    surveys: Mapping[str | date, PathLike] | Sequence[PathLike],
    output_dir: PathLike,
    *,
    roi: PathLike | None = None,
    stable: PathLike | None = None,
    alerts: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    classes: PathLike | None = None,
    corrections: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Two or more surveys of a slope through time, as ``slopewatch series``; see ``inspect`` for the arguments.

    ``alerts`` is an alert table (CSV) instead of the one that comes with SlopeWatch.
    """
    values = Values(parameters, command_sets.SERIES)
    return monitor_series(
        epochs(surveys),
        Path(output_dir),
        gathered(SeriesSettings, values.of),
        **paths(roi=roi, stable=stable, alerts=alerts, pdal=pdal),
        layers=layers(centreline, field_names, classes, corrections),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def batch(
    manifest: PathLike,
    output_dir: PathLike,
    *,
    alerts: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    classes: PathLike | None = None,
    corrections: PathLike | None = None,
    pdal: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """All slopes of a corridor, as ``slopewatch batch``; see ``inspect`` and ``monitor`` for the arguments.

    ``manifest`` is a CSV file, a layer of polygons, or a folder with one folder of dated clouds a slope. Each slope has
    a process of its own. One that fails is counted in ``slopes_failed``, named in the warnings, and raises nothing.
    """
    values = Values(parameters, command_sets.BATCH)
    for group in command_sets.BATCH:  # refused here rather than for each slope
        values.of(group)
    options = {name: value for name, value in values.given.items() if name in specifications()}
    files = paths(alerts=alerts, pdal=pdal)
    common = Common(
        options, values.profile, **files, parameters=values.of(BatchParameters),
        layers=layers(centreline, field_names, classes, corrections),
    )  # fmt: skip
    return run_batch(Given(Path(manifest), Path(output_dir), values.overwrite), common, progress or Progress())


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
        **paths(roi=roi, pdal=pdal),
        progress=progress or Progress(),
    )


def screen(
    cloud: PathLike,
    output: PathLike,
    *,
    roi: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
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
        **paths(roi=roi, pdal=pdal),
        layers=layers(centreline, field_names),
        progress=progress or Progress(),
    )

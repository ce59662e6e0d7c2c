"""From registered ground or elevation models on: registration, change, distances and motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import OutputParameters, command_sets
from ..workflows.change import change_step
from ..workflows.demchange import demchange_step
from ..workflows.displacement import displacement_step
from ..workflows.given_values import Values
from ..workflows.m3c2 import m3c2_step
from ..workflows.register import register_step
from ..workflows.settings import DisplacementSettings, DistanceSettings, ModelSettings, Settings, gathered
from .given import PathLike, day, epochs, layers, paths


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
        **paths(transform_path=transform, given=apply, stable=stable),
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
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    classes: PathLike | None = None,
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
        dates=(day(dates[0]), day(dates[1])),
        **paths(transform_path=transform, profiles=profiles, stable=stable),
        layers=layers(centreline, field_names, classes),
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
    roi: PathLike | None = None,
    stable: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Distances along normals between two registered ground clouds, as ``slopewatch m3c2``.

    ``raster_dir`` is the folder of the rasters, that of ``output`` by default; ``core`` a cloud of the points to
    measure at. ``roi`` are polygons of the slope, outside of which no core point lies. ``stable`` are polygons of
    stable ground, on which the level of detection is calibrated.
    """
    values = Values(parameters, (*command_sets.M3C2, OutputParameters))
    return m3c2_step(
        Path(reference),
        Path(moving),
        Path(output),
        gathered(DistanceSettings, values.of),
        **paths(raster_dir=raster_dir, core=core, transform_path=transform, roi=roi, stable=stable),
        dates=(day(dates[0]), day(dates[1])),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def displacement(
    reference: PathLike,
    moving: PathLike,
    output_dir: PathLike,
    *,
    dates: tuple[str | date | None, str | date | None] = (None, None),
    transform: PathLike | None = None,
    stable: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Motion along the surface of two registered ground clouds as vectors, as ``slopewatch displacement``.

    ``dates`` and ``transform`` as of ``change``; the registration's error is taken from ``transform``. ``stable`` are
    polygons of ground that has not moved; its motion is taken off all vectors.
    """
    values = Values(parameters, command_sets.DISPLACEMENT)
    return displacement_step(
        Path(reference),
        Path(moving),
        Path(output_dir),
        gathered(DisplacementSettings, values.of),
        dates=(day(dates[0]), day(dates[1])),
        **paths(transform_path=transform, stable=stable),
        layers=layers(centreline, field_names),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def dem_change(
    models: Mapping[str | date, PathLike] | Sequence[PathLike],
    output_dir: PathLike,
    *,
    stable: PathLike | None = None,
    profiles: PathLike | None = None,
    centreline: PathLike | None = None,
    field_names: PathLike | None = None,
    classes: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """Change between elevation models (GeoTIFF) of two or more dates, as ``slopewatch demchange``.

    ``models`` are given as the surveys of ``inspect``, the earliest first. ``stable`` are polygons of ground on which
    bias, shift and errors are found, ``profiles`` lines of profiles.
    """
    values = Values(parameters, command_sets.DEMCHANGE)
    return demchange_step(
        epochs(models),
        Path(output_dir),
        gathered(ModelSettings, values.of),
        **paths(stable=stable, profiles=profiles),
        layers=layers(centreline, field_names, classes),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )

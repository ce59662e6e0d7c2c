"""Surveys into files, and the products of commands from results in memory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ..engine.core.staged_outputs import atomic_output
from ..engine.epochs.epoch import Epoch
from ..engine.ground.pdal_pipelines import GROUND
from ..engine.pointcloud.plant_cover import ERROR, HEIGHT
from ..engine.report.compose import REPORT
from ..interface.parameters import ParameterSet
from ..workflows.products.change import Context
from ..workflows.run import Run
from .given import LOCAL, Survey

Dimensions = Mapping[str, NDArray[np.generic]]
_STEP_M = 0.0001


def write_survey(survey: Survey, path: Path, *, ground: bool = False, dimensions: Dimensions | None = None) -> Path:
    """Write a survey as LAZ in metres; records that laspy read keep their other dimensions.

    Args:
        ground: give all points class 2.
        dimensions: further ones of the points (n,), by name.
    """
    points = survey.points
    if survey.source is None or survey.rows is None:
        las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
        las.points = laspy.ScaleAwarePointRecord.zeros(len(points), header=las.header)
    else:
        las = laspy.LasData(survey.source.header, survey.source.points[survey.rows])
    header = laspy.LasHeader(point_format=las.header.point_format, version=las.header.version)
    header.scales = np.full(3, _STEP_M)
    header.offsets = np.floor(points.xyz.mean(axis=0))
    if points.crs is not LOCAL:
        header.add_crs(points.crs)
    out = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(len(points), header=header))
    for name in las.point_format.dimension_names:
        if name not in ("X", "Y", "Z"):
            out[name] = las[name]
    out.x, out.y, out.z = points.xyz.T
    if ground:
        out.classification[:] = GROUND
    plants = {ERROR: points.plant_error, HEIGHT: points.plant_height}
    for name, values in (plants | dict(dimensions or {})).items():
        if values is not None:
            if name not in out.point_format.dimension_names:
                out.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
            out[name] = values
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_output(path) as part:
        out.write(part, do_compress=True)
    return path


@contextmanager
def writing(
    command: str,
    folder: str | Path,
    parameters: dict[str, ParameterSet],
    names: Sequence[str],
    surveys: Mapping[str, Survey],
    warnings: Sequence[str],
    *,
    overwrite: bool,
) -> Iterator[Run]:
    """A run that writes the products of a command, files with these names, into a folder.

    Args:
        names: with that of the report, it is written, too.
        surveys: what the record names as inputs, by role; in place of a file's SHA-256 it has that of the coordinates.
        warnings: of the result.

    Raises:
        InputError: the folder holds results that are not to be replaced, or cannot be written.
    """
    run, place = Run(command, parameters), Path(folder).absolute()
    run.refuse_folder(place, ("run.json", *(n for n in names if n != "run.json")), overwrite=overwrite)
    for role, survey in surveys.items():
        digest = hash_of(survey)
        run.record.inputs.append({"role": role, "path": str(survey.points.path), "sha256": digest})
    for sentence in warnings:
        run.progress.warning(sentence)
    with run.writing(place, report=REPORT in names):
        yield run


def hash_of(survey: Survey) -> str:
    """SHA-256 of the coordinates."""
    return hashlib.sha256(survey.points.xyz.tobytes()).hexdigest()


def context_of(run: Run, pair: tuple[Survey, Survey], days: tuple[date | None, date | None], method: str) -> Context:
    """What products state about their origin."""
    hashes = tuple(hash_of(survey) for survey in pair)
    registration = pair[1].registration
    transform = None if registration is None else registration.transform
    first, later = epochs_of(pair, days)
    return Context(first, later, pair[0].points.crs, transform, hashes, method, run.run_id(hashes))


def epochs_of(surveys: Sequence[Survey], days: Sequence[date | None]) -> tuple[Epoch, ...]:
    """The surveys with their days, by which reports name them."""
    epochs = [survey.epoch(day) for survey, day in zip(surveys, days, strict=True)]
    if len({epoch.name for epoch in epochs}) == len(epochs):
        return tuple(epochs)
    return tuple(Epoch(Path(f"{epoch.name} {number}"), None) for number, epoch in enumerate(epochs, 1))


def roles_of(surveys: Sequence[Survey], days: Sequence[date | None]) -> dict[str, Survey]:
    """The surveys by their role in a record."""
    epochs = epochs_of(surveys, days)
    return {f"epoch {epoch.name}": survey for epoch, survey in zip(epochs, surveys, strict=True)}

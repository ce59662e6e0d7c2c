"""The products of commands from results in memory; loaded when something is written, as reports need much."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path

from ..engine.epochs.epoch import Epoch
from ..engine.report.compose import REPORT
from ..engine.zones.change_zones import method_name
from ..interface.parameters import ParameterSet
from ..workflows.products.change import CHANGE_OUTPUTS, ON_REQUEST, Context, write_products
from ..workflows.run import Run
from ..workflows.settings import groups
from .elevation_change import ElevationChange
from .given import Survey
from .written import hash_of


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


def write_change(found: ElevationChange, folder: str | Path, *, overwrite: bool) -> Mapping[str, Path]:
    """See ``ElevationChange.write``."""
    recorded = groups(found.parameters, "surface", "change", "zones", "heatmap", "report", "details")
    inputs, later = roles_of(found.surveys, found.days), found.surveys[1]
    names = (*CHANGE_OUTPUTS, *ON_REQUEST)
    with writing("change", folder, recorded, names, inputs, found.warnings, overwrite=overwrite) as run:
        method = method_name(found.parameters.change, found.result.direction)
        context = context_of(run, found.surveys, found.days, method)
        run.facts["run_id"] = context.run_id
        if later.registration is not None:
            run.facts["transform"] = later.registration.transform.matrix
            run.facts["registration"] = later.registration.stated()
        write_products(run, found.result, later.points, context, found.parameters)
    return run.outputs

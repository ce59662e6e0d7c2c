"""What is done with finished runs: the report again, files for other systems or a database, a project of QGIS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..interface.parameters import (
    DetailParameters,
    HandoverParameters,
    ProjectParameters,
    ReportParameters,
    command_sets,
)
from ..workflows.createproject import project_step
from ..workflows.exportgis import export_step
from ..workflows.given_values import Values
from ..workflows.report_corridor import report_of_folder
from .given import PathLike, paths


def report(
    folder: PathLike,
    *,
    profiles: PathLike | None = None,
    photos: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """The report of a finished run or corridor again, as ``slopewatch report``; with ``pdf=True`` also that to sign.

    ``profiles`` are lines, ``photos`` is a folder of pictures that are named after zones.
    """
    values = Values(parameters, command_sets.REPORT)
    return report_of_folder(
        Path(folder),
        values.of(ReportParameters),
        details=values.of(DetailParameters),
        **paths(profiles=profiles, photos=photos),
        progress=progress or Progress(),
    )


def export_gis(
    run: PathLike,
    output: PathLike | None = None,
    *,
    to: str = "",
    fields: PathLike | None = None,
    progress: Progress | None = None,
    **parameters: Any,
) -> RunResult:
    """The results in the folder ``run`` as files of other systems, as ``slopewatch exportgis``.

    ``output`` is an archive (.zip) or a folder, ``to`` the address of a database with PostGIS that zones, events and
    their history go to; one of them is needed. ``fields`` is a JSON or CSV file with an agency's names of fields.
    """
    values = Values(parameters, command_sets.EXPORTGIS)
    return export_step(
        Path(run),
        **paths(output=output, fields=fields),
        parameters=values.of(HandoverParameters),
        address=to,
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )


def create_project(
    run: PathLike, output: PathLike, *, progress: Progress | None = None, **parameters: Any
) -> RunResult:
    """A QGIS project (``output``, .qgz) of the results in the folder ``run``, as ``slopewatch createproject``.

    QGIS makes it in a process of its own, so it must be installed.
    """
    values = Values(parameters, command_sets.CREATEPROJECT)
    return project_step(
        Path(run),
        Path(output),
        values.of(ProjectParameters),
        overwrite=values.overwrite,
        progress=progress or Progress(),
    )

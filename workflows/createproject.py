"""``slopewatch createproject``: a finished run as a QGIS project, made by QGIS itself."""

from __future__ import annotations

import os
from pathlib import Path

from ..engine.core.errors import EngineError, InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.qgis_program import find_qgis_process, run_algorithm
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_unwritable
from ..engine.handover.held import find_record, read_record
from ..interface.language import ENGLISH, current_language
from ..interface.parameters import ProjectParameters

_ENDINGS = (".qgz", ".qgs")


def project_step(
    run_folder: Path, output: Path, parameters: ProjectParameters, *, overwrite: bool, progress: Progress
) -> RunResult:
    """Write a project of the layers in the folder of a finished run.

    Raises:
        InputError: no finished run, no QGIS, or a project that is there already; nothing is written then.
        EngineError: QGIS failed.
    """
    if output.suffix.lower() not in _ENDINGS:
        raise InputError(f"The output {shown(output)} is to be a project; end its name in .qgz.")
    refuse_unwritable(output)
    record = find_record(run_folder)
    read_record(record)
    if output.exists() and not overwrite:
        # as of folders with results, whose option it is
        raise InputError(
            f"The folder {output.absolute().parent} holds results already ({output.name}); choose another one, or give "
            "--overwrite to replace them."
        )
    program = find_qgis_process()
    given = {
        "INPUT": str(run_folder.absolute()),
        "OUTPUT": str(output.absolute()),
        "PROJECT_TITLE": parameters.project_title,
        "AUTHOR": parameters.author,
        "PAPER": parameters.paper,
        "OVERWRITE": "true" if overwrite else "false",
    }
    environ = dict(os.environ)
    if current_language() != ENGLISH:  # the words of the layers are QGIS's own
        environ |= {"LANG": f"{current_language()}.UTF-8", "LC_CTYPE": "C.UTF-8"}
        environ.pop("LC_ALL", None)
    progress.update(0.1, "making the project in QGIS")
    results = run_algorithm(program, "createproject", given, environ)
    if not output.is_file():
        raise EngineError(f"QGIS ended well, but {output.name} was not written")
    progress.update(1.0, "making the project in QGIS")
    figures = {"layers": results.get("LAYERS"), "layout": results.get("LAYOUT")}
    return RunResult({"project": output.absolute()}, figures, tuple(progress.warnings))

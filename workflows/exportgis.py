"""``slopewatch exportgis``: the results of a finished run as files of other systems, with checksums."""

from __future__ import annotations

from pathlib import Path

from ..engine.core import cancellation
from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import Stage, refuse_unwritable
from ..engine.handover import package
from ..engine.handover.held import find_record, read_held
from ..engine.handover.postgis.address import Database, parse_address
from ..engine.handover.postgis.schema import check_name
from ..engine.handover.postgis.writing import Counts
from ..engine.vector.field_mapping import read_field_mapping
from ..interface.parameters import HANDOVER_FORMATS, HandoverParameters, OutputParameters
from .handover_parts import HandOver
from .postgis import for_database
from .run import Run, record_name_of

HANDOVER_OUTPUTS = ("item.json", package.CHECKSUMS, "run.json")


def export_step(
    run_folder: Path,
    output: Path | None,
    parameters: HandoverParameters,
    *,
    address: str = "",
    fields: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Write what the folder of a finished run holds in the chosen formats, with a file of checksums, or to a database.

    Args:
        run_folder: the folder, or the run record in it.
        output: a ZIP archive where the name ends in ``.zip``, else a folder; None: the database only.
        address: of a database for zones, events and their history; empty: none. It is in no record.
        fields: mapping file of field names, see ``read_field_mapping``.

    Raises:
        InputError: the run is not finished, or something given cannot be used; nothing is written then.
    """
    database = parse_address(address) if address else None
    if database is not None:
        check_name(parameters.schema)
    if output is None:
        if database is None:
            raise InputError("Neither --output nor --to was given; say where the results are to go.")
        return _to_database(run_folder, database, parameters, fields, progress)
    chosen = _formats(parameters.formats)
    record = find_record(run_folder)
    groups = {"handover": parameters, "outputs": OutputParameters(overwrite=overwrite)}
    run = Run("exportgis", groups, [("run", record), ("fields", fields)], progress)
    zipped = output.suffix.lower() == ".zip"
    folder = output.absolute().parent if zipped else output.absolute()
    names = (output.name, record_name_of(output)) if zipped else HANDOVER_OUTPUTS
    if zipped:
        refuse_unwritable(output)
    elif folder == record.parent.absolute():
        raise InputError(f"The output {shown(output)} is the folder of the run itself; give another one.")
    run.refuse_folder(folder, names, overwrite=overwrite)
    run.hash_inputs()
    with run.step("read", 0.0, 0.1, "reading the results"):
        held = read_held(run_folder)
        rows = None if database is None else for_database(database, held, fields, progress)
        handover = HandOver(held, parameters, read_field_mapping(fields).flat, chosen, progress)
    with (
        run.writing(folder, record_name=names[-1]) as stage,
        cancellation.temporary(stage.folder / "packed") as packed,
    ):
        packed.mkdir()
        place = packed if zipped else stage.folder
        with run.step("write", 0.1, 0.95, "writing"):
            files = handover.write(place)
        with run.step("package", 0.95, 1.0, "packing"):
            files.append(package.write_checksums(place, files))
            run.outputs |= _pack(stage, place, files, output.name if zipped else "")
        size = sum((place / name).stat().st_size for name in files)
        run.figures = {
            "files": len(files),
            "bytes": size,
            "layers": handover.layers,
            "rasters": handover.rasters,
        } | ({"slopes": handover.slopes} if handover.slopes else {})
        run.facts["not_held"] = handover.not_held
        if rows is not None:  # last, so that no file is missing of what a database has
            run.figures |= _counts(rows.write(parameters, progress))
            run.facts["database"] = {"address": rows.database.shown, "schema": parameters.schema}
    return run.result()


def _pack(stage: Stage, place: Path, files: list[str], archive: str) -> dict[str, Path]:
    """The files into ``archive``, or as they are where that is empty; the outputs by name."""
    if archive:
        package.write_zip(stage.path(archive), place, files)
        return {"handover": stage.final(archive)}
    for name in package.named_in(stage.directory).difference(files):  # of the hand-over that this one replaces
        stage.discard(name)
    return {name: stage.final(name) for name in files}


def _to_database(
    run_folder: Path, database: Database, parameters: HandoverParameters, fields: Path | None, progress: Progress
) -> RunResult:
    """Only that; no file is written."""
    with progress.stage(0.0, 0.3, "reading the results"):
        rows = for_database(database, read_held(run_folder), fields, progress)
    with progress.stage(0.3, 1.0, "handing over"):
        figures = _counts(rows.write(parameters, progress))
    said = (
        f"{figures['database_zones']} zones and {figures['database_events']} events were handed over to "
        f"{database.shown}, schema {parameters.schema}; {figures['database_history']} entries are new in the history."
    )
    return RunResult({}, figures, tuple(progress.warnings), (said,))


def _counts(counts: Counts) -> dict[str, int]:
    return {f"database_{name}": getattr(counts, name) for name in ("zones", "events", "history", "newer")}


def _formats(text: str) -> tuple[str, ...]:
    """The chosen formats in the order in which they are written.

    Raises:
        InputError: one is not known, or none is given.
    """
    given = [word for part in text.split(",") if (word := part.strip().lower())]
    odd = next((word for word in given if word not in HANDOVER_FORMATS), None)
    known = ", ".join(HANDOVER_FORMATS)
    if odd is not None:
        raise InputError(f"formats has {shown(odd)}, which is none; give some of {known}.")
    if not given:
        raise InputError(f"formats is empty; give some of {known}.")
    return tuple(word for word in HANDOVER_FORMATS if word in given)

"""The command ``exportgis``."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import HandoverParameters, command_sets
from .options import PATH, Session, command, path_option


@click.command()
@click.argument("run", type=PATH)
@path_option("--output", "A ZIP archive (.zip), or a folder, which is created if missing.")
@click.option(
    "--to",
    "address",
    default="",
    metavar="ADDRESS",
    help="Database with PostGIS that zones, events and their history go to: postgresql://user@host/database.",
)
@path_option("--fields", "Names that were agreed on: a JSON object, or a CSV of the columns ours,theirs.")
@command(*command_sets.EXPORTGIS, profile=False)
def exportgis(session: Session, run: Path, output: Path | None, address: str, fields: Path | None) -> RunResult:
    """The results in the folder RUN as files of other systems, with metadata and checksums.

    RUN is the folder of a finished inspect, change, series, screen, displacement, demchange, batch, m3c2, locate,
    planflight or compareflight, or the run record in it. What it does not hold is not written. Give --output, --to or
    both; the database's password is best in PGPASSWORD or ~/.pgpass.
    """
    from ..workflows.exportgis import export_step

    return export_step(
        run,
        output,
        session.parameters(HandoverParameters),
        address=address,
        fields=fields,
        overwrite=session.overwrite,
        progress=session.report,
    )

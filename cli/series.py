"""``slopewatch series``: more than two surveys of one slope."""

from __future__ import annotations

from pathlib import Path

import click

from ..engine.core.run_result import RunResult
from ..interface.parameters import command_sets
from .options import OUTPUT_DIR, PATH, ROI, STABLE, Session, command, path_option, related


@click.command()
@click.argument("source", type=PATH, required=False, metavar="[FOLDER|MANIFEST]")
@click.option(
    "--epoch",
    "epochs",
    multiple=True,
    metavar="[DATE=]CLOUD",
    help="A survey: the date it was flown (YYYY-MM-DD, else from the file's name) and its LAS or LAZ file. Give each, "
    "the earliest first, instead of a folder or a manifest.",
)
@ROI
@STABLE
@path_option(
    "--alerts",
    "Alert table (CSV) instead of the one that comes with SlopeWatch, of which alerts_used.csv in the outputs is a "
    "copy to start from.",
)
@related(corrections=True)
@OUTPUT_DIR
@command(*command_sets.SERIES)
def series(
    session: Session,
    source: Path | None,
    epochs: tuple[str, ...],
    roi: Path | None,
    stable: Path | None,
    alerts: Path | None,
    output_dir: Path,
    **layers: Path | None,
) -> RunResult:
    """Two or more surveys of one slope: change in steps and in total, velocities, zones through time, alert levels.

    FOLDER holds one cloud per survey, each with its date in its name (2024-05-01.laz); MANIFEST is a CSV file with the
    columns date and path. All surveys are registered to the first. When run again with one more survey, only that one
    is computed: a series that continues with the same settings needs no --overwrite. This screens trends; it is no
    alarm system.
    """
    from ..engine.core.errors import InputError
    from ..engine.epochs.epoch import parse_epoch
    from ..engine.epochs.manifest import epochs_of
    from ..workflows.layer_files import LayerFiles
    from ..workflows.series import monitor_series
    from ..workflows.settings import SeriesSettings, gathered

    if (source is None) == (not epochs):
        raise InputError("Give either a folder or manifest of the surveys, or --epoch DATE=CLOUD for each of them.")
    settings = gathered(SeriesSettings, session.parameters)
    return monitor_series(
        [parse_epoch(e) for e in epochs] if source is None else epochs_of(source),
        output_dir,
        settings,
        roi=roi,
        stable=stable,
        alerts=alerts,
        layers=LayerFiles(**layers),
        pdal=session.pdal,
        overwrite=session.overwrite,
        progress=session.report,
    )

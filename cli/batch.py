"""``slopewatch batch``: the slopes of a corridor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from ..engine.core.errors import InputError
from ..engine.core.messages import shown
from ..engine.core.run_result import RunResult
from ..interface.parameters import BatchParameters, command_sets
from ..interface.protocol import SOME_FAILED
from .options import OUTPUT_DIR, PATH, Session, command, path_option, related


@click.command()
@click.argument("manifest", type=PATH)
@related(corrections=True)
@path_option("--alerts", "Alert table (CSV) for all series instead of the one that comes with SlopeWatch.")
@OUTPUT_DIR
@command(*command_sets.BATCH)
def batch(session: Session, manifest: Path, alerts: Path | None, output_dir: Path, **layers: Path | None) -> RunResult:
    """All slopes of a corridor, each in a process of its own: their results, and what they show together.

    MANIFEST is a CSV file with the columns slope, date, file and roi (optional: stable, alerts, centreline, classes,
    corrections, profile, and settings by their names), a layer of polygons with slope, date and file, or a folder with
    one folder of dated clouds a slope. One survey is screened, two are compared, more are a series. A slope that fails
    is a row of the results; a batch that was stopped goes on where it was.
    """
    from ..workflows.batch.corridor import run_batch
    from ..workflows.batch.corridor_plan import Given
    from ..workflows.batch.planning import Common
    from ..workflows.batch.settings import specifications
    from ..workflows.layer_files import LayerFiles

    options = {name: value for name, value in session.values.items() if name in specifications() and value is not None}
    files = LayerFiles(**layers)
    common = Common(options, session.profile, alerts, session.pdal, session.parameters(BatchParameters), files)
    return _with_exit_code(run_batch(Given(manifest, output_dir, session.overwrite), common, session.report))


def _with_exit_code(done: RunResult) -> RunResult:
    """The result with the code that says whether slopes failed.

    Raises:
        InputError: no slope has results.
    """
    figures = done.figures
    if not figures["slopes_done"]:
        page = shown(done.outputs["page"])
        raise InputError(f"No slope has results; correct the manifest or the surveys ({page} says what is wrong).")
    return replace(done, exit_code=SOME_FAILED) if figures["slopes_failed"] else done

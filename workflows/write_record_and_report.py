"""The run record and the report, written together at the end of a command."""

from __future__ import annotations

from pathlib import Path

from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import Stage
from ..engine.report.compose import REPORT, write_report


def write_record_and_report(record: RunRecord, stage: Stage, progress: Progress, outputs: dict[str, Path]) -> None:
    """The last two outputs of a run: ``run.json``, and the report, which is made of it and of the other outputs.

    The record promises the report, and both wait in the stage, so that neither appears without the other. The record is
    written again at the end, for the report's own entry among its stages; the report shows none of these.
    """
    outputs["report"] = stage.final(REPORT)
    record.write(stage.path("run.json"), progress.warnings, outputs)
    with progress.stage(0.99, 1.0, "drawing the report"), record.stage("report"):
        write_report(stage.folder)
    record.write(stage.path("run.json"), progress.warnings, outputs)

"""The command `ground`: a raw cloud in, its ground points out."""

from __future__ import annotations

from pathlib import Path

from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_record import RunRecord
from ..engine.core.staged_outputs import (
    refuse_inputs_as_outputs,
    refuse_other_than_cloud,
    refuse_unwritable,
    staged_outputs,
)
from ..engine.ground.cover import cover_sentence, cover_table
from ..engine.ground.extraction import extract_ground
from ..engine.pointcloud.pdal_program import find_pdal
from .inspect import Outcome
from .run import _record_name
from .settings import Settings


def ground_step(
    cloud: Path, output: Path, settings: Settings, *, roi: Path | None, pdal: Path | None, progress: Progress
) -> Outcome:
    """Clip, denoise and extract the ground of one cloud; see ``ground.extract_ground``."""
    refuse_other_than_cloud(output)
    refuse_unwritable(output)
    stem = output.stem.removesuffix("_ground") or output.stem
    written = [output, *(output.with_name(f"{stem}_{kind}.laz") for kind in ("clipped", "classified"))]
    refuse_inputs_as_outputs(written, [cloud] + ([roi] if roi else []))
    program = find_pdal(pdal)
    record = RunRecord("ground", {"inputs": settings.inputs, "ground": settings.ground})
    record.facts["pdal"] = {"version": program.version, "path": program.path, "found": program.how}
    record.add_input("cloud", cloud)
    if roi is not None:
        record.add_input("roi", roi)
    with staged_outputs(output.absolute().parent, last=_record_name(output)) as stage:
        with record.stage("ground") as entry:
            result = extract_ground(
                cloud,
                stage.path(output.name),
                roi=roi,
                parameters=settings.ground,
                inputs=settings.inputs,
                pdal=program,
                final=stage.directory,
                progress=progress,
            )
            entry.update(plain(result))
        if result.cover is not None:
            for line in (cover_sentence(result.cover), *cover_table(result.cover)):
                progress.info(line)
        outputs = {
            "ground": stage.final(output.name),
            "clipped": stage.final(result.clipped.name),
            "run": stage.final(_record_name(output)),
        }
        record.metrics = result.figures()
        record.write(stage.path(_record_name(output)), progress.warnings, outputs)
    return outputs, record.metrics

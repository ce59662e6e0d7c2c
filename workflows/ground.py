"""The command `ground`: a raw cloud in, its ground points out."""

from __future__ import annotations

from pathlib import Path

from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_other_than_cloud, refuse_unwritable
from ..engine.ground.cover import cover_table
from ..engine.ground.extraction import extract_ground
from .run import Run, record_name_of
from .settings import Settings, groups


def ground_step(
    cloud: Path, output: Path, settings: Settings, *, roi: Path | None, pdal: Path | None, progress: Progress
) -> RunResult:
    """Clip, denoise and extract the ground of one cloud; see ``ground.extract_ground``."""
    refuse_other_than_cloud(output)
    refuse_unwritable(output)
    run = Run("ground", groups(settings, "inputs", "ground"), [("cloud", cloud), ("roi", roi)], progress)
    stem = output.stem.removesuffix("_ground") or output.stem
    run.refuse_outputs([output, *(output.with_name(f"{stem}_{kind}.laz") for kind in ("clipped", "classified"))])
    program = run.find_pdal(pdal)
    run.hash_inputs()
    with run.writing(output.absolute().parent, record_name=record_name_of(output)) as stage:
        with run.step("ground") as entry:
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
            for line in (result.sentence(), *cover_table(result.cover)):
                progress.info(line)
        run.outputs |= {"ground": stage.final(output.name), "clipped": stage.final(result.clipped.name)}
        run.figures = result.figures()
    return run.result()

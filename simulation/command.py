"""``slopewatch simulate survey``: a simulated pair in an output folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..engine.outputs import staged_outputs
from ..engine.parameters import SurveyParameters
from ..engine.progress import Progress
from ..engine.run_record import RunRecord
from .survey import simulate_pair
from .write import write_pair

_NAMES = {"first": "reference", "second": "cloud"}


def survey_step(
    parameters: SurveyParameters, output_dir: Path, progress: Progress
) -> tuple[dict[str, Path], dict[str, Any]]:
    """Simulate a pair of surveys and write it with its truth; nothing is left when it fails.

    Returns:
        Paths by name (``reference`` and ``cloud`` are the earlier and the later survey, the rest as in
        ``write_pair``, and ``run``) and the main figures.
    """
    record = RunRecord("simulate survey", {"survey": parameters})
    with staged_outputs(output_dir) as stage:
        with record.stage("simulate"), progress.stage(0.0, 0.8, "simulating"):
            pair = simulate_pair(parameters, progress)
        with record.stage("write"), progress.stage(0.8, 1.0, "writing"):
            written = write_pair(pair, stage.folder, progress)
        outputs = {_NAMES.get(name, name): stage.final(path.name) for name, path in written.items()}
        outputs["run"] = stage.final("run.json")
        record.metrics = {
            "points_reference": len(pair.first),
            "points_cloud": len(pair.second),
            "ground_share": float(pair.first.truth_ground.mean()),
            "vegetation_cover": pair.canopy.cover(pair.scene.slope),
            "changes": len(pair.changes),
            "volume_raised_m3": sum(change.volumes[0] for change in pair.changes),
            "volume_lowered_m3": sum(change.volumes[1] for change in pair.changes),
        }
        record.write(stage.path("run.json"), progress.warnings, outputs)
    return outputs, record.metrics

"""Folders of finished runs to hand over, and what was handed over of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.core.run_result import RunResult
from slopewatch.interface.parameters import HandoverParameters
from slopewatch.tests.builders.known_changes import write_clouds, write_models
from slopewatch.workflows.demchange import demchange_step, parse_model
from slopewatch.workflows.displacement import displacement_step
from slopewatch.workflows.exportgis import export_step
from slopewatch.workflows.settings import DisplacementSettings, ModelSettings

FEW_POINTS = 900
"""Of a surface, so that the drawings stay small."""


def pit(folder: Path) -> Path:
    """Results with one zone, two surfaces and a section: a pit between two elevation models."""
    models = [parse_model(str(path)) for path in write_models(folder)]
    demchange_step(models, folder / "pit", ModelSettings(), progress=Progress())
    return folder / "pit"


def motion(folder: Path) -> Path:
    """Results with vectors and a zone, without surfaces."""
    first, later = write_clouds(folder)
    displacement_step(first, later, folder / "motion", DisplacementSettings(), dates=(None, None), transform_path=None,
                      progress=Progress())  # fmt: skip
    return folder / "motion"


def hand_over(run: Path, output: Path, *, fields: Path | None = None, progress: Progress | None = None,
              overwrite: bool = False, **given: object) -> RunResult:  # fmt: skip
    parameters = HandoverParameters.build({"surface_points": FEW_POINTS, **given})
    return export_step(run, output, parameters, fields=fields, overwrite=overwrite, progress=progress or Progress())


def signed_area(ring: np.ndarray) -> float:
    """Positive where the ring (n, 2) runs counterclockwise."""
    x, y = ring.T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2)

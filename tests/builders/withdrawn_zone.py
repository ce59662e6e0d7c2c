"""A corridor of one slope whose zone moved and then came to rest, so that its alert was raised and withdrawn.

``python -m slopewatch.tests.builders.withdrawn_zone FOLDER`` makes it there, for tests in QGIS's interpreter.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path

from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.interface.parameters import BatchParameters, DisplacementStepParameters
from slopewatch.tests.builders.series_clouds import FIXED, plane
from slopewatch.workflows.batch.jobs import Slope, Survey
from slopewatch.workflows.batch.products import Made, read_alerts, write_products
from slopewatch.workflows.batch.results import SlopeResult
from slopewatch.workflows.run import Run
from slopewatch.workflows.series import monitor_series

SLOPE = "S12"
FIRST_DAY, DAYS_APART = date(2024, 5, 1), 30
DEPTHS_M = (0.0, 0.1, 0.2, 0.2, 0.2)
"""Of the square that sinks, at each survey."""
RAISED_WITH = 3
"""Surveys of the run that raises the alert; the next run has all of them."""


def withdrawn_corridor(corridor: Path) -> Path:
    """Make the corridor with both runs; the folder of the slope's results."""
    folder, clouds = corridor / "slopes" / SLOPE / "series", corridor / "clouds"
    clouds.mkdir(parents=True)
    epochs = [
        Epoch(plane(clouds / f"{number}.laz", bump=-depth, seed=number), FIRST_DAY + timedelta(DAYS_APART * number))
        for number, depth in enumerate(DEPTHS_M)
    ]
    series = replace(FIXED.series, rasters_each_survey=False)
    settings = replace(FIXED, series=series, displacement_step=DisplacementStepParameters(displacement=False))
    for count in (RAISED_WITH, len(epochs)):
        monitor_series(epochs[:count], folder, settings)
        _write_corridor(corridor, folder, epochs[:count])
    return folder


def _write_corridor(corridor: Path, folder: Path, epochs: list[Epoch]) -> None:
    record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    outputs = {name: folder / path for name, path in record["outputs"].items()}
    slope = Slope(SLOPE, tuple(Survey(epoch.date, epoch.path) for epoch in epochs if epoch.date))
    run = Run("batch", {"batch": BatchParameters()}, (), Progress())
    run.figures = {"slopes": 1}
    result = SlopeResult(SLOPE, folder, record, outputs)
    earlier = read_alerts(corridor)
    with run.writing(corridor):
        write_products(run, Made([slope], [result], (), corridor / "m.csv", {}), earlier)


if __name__ == "__main__":
    withdrawn_corridor(Path(sys.argv[1]))

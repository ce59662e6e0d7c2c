"""The picture of the guide's section on series: `lab/pictures/series_picture.py` writes docs/images/series.png."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from slopewatch.engine.epochs.manifest import epochs_of
from slopewatch.interface.parameters import GridChangeParameters, SeriesParameters, SurveyParameters
from slopewatch.simulation.surveys.series import Creep, Settling, simulate_series, survey_days, write_series
from slopewatch.workflows.series import monitor_series
from slopewatch.workflows.settings import SeriesSettings

ROOT = Path(__file__).resolve().parents[2]


def main() -> None:
    """Six monthly surveys of a simulated cut slope with three zones that move."""
    parameters = SurveyParameters(seed=1, points=60_000, length=24.0, height=9.0, vegetation=0.3, offset=0.05)
    laws = (Creep(-0.002, 15.0), Creep(0.005, 45.0), Settling(-0.8, 50.0))
    series = simulate_series(parameters, survey_days(6, 30), laws)
    with tempfile.TemporaryDirectory() as name:
        paths = write_series(series, Path(name), ground_only=True)
        settings = SeriesSettings(
            change=GridChangeParameters(cell=0.25),
            series=SeriesParameters(ground_ready=True, rasters_each_survey=False),
        )
        outputs = monitor_series(epochs_of(Path(name)), Path(name) / "out", settings, roi=paths["roi"]).outputs
        shutil.copyfile(outputs["series_picture"], ROOT / "docs" / "images" / "series.png")


if __name__ == "__main__":
    main()

"""Whether the season that `planflight --season` names is the one whose plants let most pulses pass.

    .venv/bin/python lab/trials/season_trial.py FOLDER

One simulated slope is surveyed in four months with plants of its own in each: 70 % of it covered in July, 50 % in
October, 20 % in February and April. `ground` extracts the ground of each, as of a real survey; the truth is the share
of pulses that the simulation let reach the ground.
"""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path

import laspy
import numpy as np
import shapely
from pyproj import CRS
from slopewatch import api
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.vector.geopackage import read_layer
from slopewatch.interface.parameters import SurveyParameters
from slopewatch.simulation.frame import Frame
from slopewatch.simulation.surveys.layers import Landscape
from slopewatch.simulation.surveys.plants import cover_of
from slopewatch.simulation.surveys.scanner import scan
from slopewatch.simulation.surveys.scene import Relief
from slopewatch.simulation.surveys.survey import built_slope, expand, rectangle
from slopewatch.simulation.surveys.write import write_region, write_survey

MONTHS = {2: 0.2, 4: 0.2, 7: 0.7, 10: 0.5}
SYSTEM = CRS.from_user_input("EPSG:32651")


def run(folder: Path) -> dict:
    """Truth and figures of the four months."""
    folder.mkdir(parents=True, exist_ok=True)
    roi, wide, clouds, truth = folder / "roi.gpkg", folder / "wide.gpkg", [], {}
    for month, cover in MONTHS.items():
        parameters = SurveyParameters(
            seed=31, vegetation=cover, angle=37.0, points=200_000, length=36.0, height=18.0, offset=0.0, amplitude=0.0
        )
        slope = built_slope(parameters, Relief(), Frame(), 0.0, Progress())
        landscape = Landscape(slope.scene, slope.canopy, cover_of(parameters, slope.scene, 0))
        cloud = scan(landscape, slope.plan, expand(slope.roi, 6.0), 200_000, 0.02, (31, month))
        write_region(roi, rectangle(slope.roi, slope.scene.frame), SYSTEM, date(2025, 1, 1))
        write_region(wide, rectangle(expand(slope.roi, 3.0), slope.scene.frame), SYSTEM, date(2025, 1, 1))
        path = folder / f"2025-{month:02d}-15.laz"
        write_survey(path, cloud, SYSTEM, f"2025-{month:02d}-15")
        api.extract_ground(path, folder / f"ground-2025-{month:02d}-15.laz", roi=wide)
        clouds.append(next(folder.glob(f"ground-2025-{month:02d}-15*classified.laz")))
        las = laspy.read(path)
        region = shapely.union_all(read_layer(roi).geometry.values)
        inside = shapely.contains_xy(region, np.asarray(las.x), np.asarray(las.y))
        pulses = int((np.asarray(las.return_number)[inside] == 1).sum())
        truth[month] = float((np.asarray(las.truth_ground)[inside] == 1).sum()) / pulses
    api.plan_flight(
        folder / "ground-2025-02-15.laz", roi, folder / "plan", season=clouds, pulse_rate=16000.0, bridged_terrain=30.0,
        overwrite=True,
    )  # fmt: skip
    found = json.loads((folder / "plan" / "run.json").read_text(encoding="utf-8"))["metrics"]["season"]
    return {"truth": truth, "found": found}


if __name__ == "__main__":
    print(json.dumps(run(Path(sys.argv[1])), indent=1))

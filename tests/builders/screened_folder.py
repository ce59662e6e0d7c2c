"""An output folder of one survey that was screened, as ``inspect`` writes it, without its hours of computing."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas as gpd
import laspy
import numpy as np
from pyproj import CRS
from shapely.geometry import Point
from slopewatch.engine.report.signed.screened_ground import LABELS
from slopewatch.engine.vector.geopackage import write_layer
from slopewatch.tests.builders.screening_clouds import BULGE, HOLLOW, RADIUS, SOUTH, WEST, slope

SMALLEST_M = 0.168
"""Height of a hazard 3 m wide that shows on half of the ground."""


def labelled_cloud(path: Path, points: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    """A slope with a bulge labelled 1 and a hollow labelled 2; its points (n, 3) and labels (n,)."""
    xyz = slope(points)
    labels = np.zeros(len(xyz), dtype=np.uint8)
    for label, middle in ((1, BULGE), (2, HOLLOW)):
        labels[np.hypot(*(xyz[:, :2] - middle - (WEST, SOUTH)).T) < 0.8 * RADIUS] = label
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [WEST, SOUTH, 0]
    header.add_crs(CRS(32651))
    header.add_extra_dim(laspy.ExtraBytesParams(LABELS, np.uint8))
    las = laspy.LasData(header)
    las.xyz = xyz
    las[LABELS] = labels
    las.write(path)
    return xyz, labels


def screened_folder(folder: Path) -> Path:
    """Labelled cloud, table of zones and record of one survey; two zones."""
    folder.mkdir()
    labelled_cloud(folder / "screened.laz")
    columns = {
        "zone_id": ["H001", "H002"], "kind": ["uplift", "subsidence"], "confidence": ["high", "medium"],
        "probability": [0.9, 0.8], "height_med_m": [0.25, -0.2], "height_p95_m": [0.3, -0.3],
        "area_m2": [14.0, 12.0], "slope_deg": [35.0, 35.0], "points": [900, 800],
    }  # fmt: skip
    shapes = [Point(WEST + x, SOUTH + y).buffer(0.8 * RADIUS) for x, y in (BULGE, HOLLOW)]
    write_layer(folder / "screened_zones.gpkg", gpd.GeoDataFrame(columns, geometry=shapes, crs=32651), "zones")
    record = {
        "software": "SlopeWatch", "command": "inspect", "started": "2026-11-23T10:00:00+00:00", "parameters": {},
        "inputs": [{"role": "epoch 2025-05-01", "path": "2025-05-01.laz", "sha256": "0" * 64}],
        "metrics": {
            "screened_zone_count": 2, "screened_zone_area_m2": 26.0, "screened_uplift_zones": 1,
            "screened_subsidence_zones": 1, "screened_area_m2": 590.0, "screened_ground_points": 20_000,
            "screened_density": 34.0, "screened_smallest_hazard_m": {"3": {"median": SMALLEST_M}},
        },
        "detectable": (
            "On half of this slope a hazard 3 m wide must stand 0.17 m out of or below the ground around it to be "
            "found by screening (2 m: 0.25 m; 5 m: 0.19 m; 8 m: 0.22 m)."
        ),
        "warnings": [], "versions": {},
        "outputs": {"screened": "screened.laz", "screened_zones": "screened_zones.gpkg", "run": "run.json"},
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps(record), encoding="utf-8")
    return folder

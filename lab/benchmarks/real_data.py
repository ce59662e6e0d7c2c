"""The real clouds that benchmarks measure, where they lie next to the checkout (``../shared/data``)."""

from __future__ import annotations

import csv
from datetime import datetime
from pathlib import Path

import numpy as np

from ...engine.core.arrays import Float
from ...engine.pointcloud.reading import read_cloud
from ...interface.parameters import InputParameters

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TILES = DATA / "real" / "ign_tiles"
DENSE = DATA / "real" / "lone-star.copc.laz"
DENSE_HALVES = "real cloud (392 points/m²) split in two halves"
_DENSE_CRS = "EPSG:32614"  # the file declares a geocentric system but holds projected coordinates


def alarm_series() -> list[tuple[str, Float, Float]]:
    """Published displacements that accelerate to a failure: name, days (n,) and displacement (n,) in metres."""
    found = []
    for path in sorted((DATA / "alarms").glob("*.csv")):
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        times = [datetime.fromisoformat(row["date"].replace("Z", "")) for row in rows]
        days = np.array([(time - times[0]).total_seconds() / 86_400 for time in times])
        found.append((path.stem, days, np.array([float(row["disp"]) for row in rows]) / 1000))
    return found


def dense_cloud() -> Float | None:
    """The points (n, 3) of the densest cloud, metres; None where it is missing."""
    return read_cloud(DENSE, InputParameters(crs=_DENSE_CRS)).xyz if DENSE.exists() else None


def split(cloud: Float, seed: int) -> tuple[Float, Float]:
    """Points (n, 3) dealt out at random: two surveys of the same ground in the same coordinates."""
    half = np.random.default_rng(seed).permutation(len(cloud)) < len(cloud) // 2
    return cloud[half], cloud[~half]

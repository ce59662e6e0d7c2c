"""A cloud's points as PDAL reads them, an independent reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from slopewatch.tests.builders.extracted_ground import any_pdal


def by_pdal(path: Path, *names: str) -> dict[str, np.ndarray]:
    """Columns of the points as PDAL reads them."""
    pdal = any_pdal()
    table = path.with_suffix(".csv")
    text = {"type": "writers.text", "filename": str(table), "order": ",".join(names), "keep_unspecified": False}
    pdal.run([{"type": "readers.las", "filename": str(path)}, {**text, "precision": 9}])
    return dict(zip(names, np.loadtxt(table, delimiter=",", skiprows=1, ndmin=2).T, strict=True))

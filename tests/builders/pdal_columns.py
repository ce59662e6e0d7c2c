"""A cloud's points as PDAL reads them, an independent reader."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud.pdal_program import find_pdal


def by_pdal(path: Path, *names: str) -> dict[str, np.ndarray]:
    """Columns of the points as PDAL reads them."""
    try:
        pdal = find_pdal()
    except InputError as error:
        pytest.skip(f"no PDAL to read clouds with: {error}")
    table = path.with_suffix(".csv")
    text = {"type": "writers.text", "filename": str(table), "order": ",".join(names), "keep_unspecified": False}
    pdal.run([{"type": "readers.las", "filename": str(path)}, {**text, "precision": 9}])
    return dict(zip(names, np.loadtxt(table, delimiter=",", skiprows=1, ndmin=2).T, strict=True))

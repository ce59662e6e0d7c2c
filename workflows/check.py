"""``slopewatch check``: is everything that SlopeWatch needs there, and does it work."""

from __future__ import annotations

import importlib
import importlib.metadata
import shutil
import sys
from pathlib import Path
from typing import Any

from ..engine.core.errors import InputError
from ..engine.core.run_record import versions
from ..engine.pointcloud.clipping import CLIPPED_BY
from ..engine.pointcloud.pdal_program import find_pdal
from ..models.network.shipped import RELIEF_SHA256, RELIEF_WEIGHTS, SHIPPED_SHA256, SHIPPED_WEIGHTS

LIBRARIES = (
    *("click", "geopandas", "jinja2", "laspy", "lazrs", "matplotlib", "numpy", "pyogrio", "pyproj", "rasterio"),
    *("rich", "safetensors", "scipy", "shapely", "threadpoolctl"),
)
OPTIONAL = {
    "numba": "not there; the same is computed, slower",
}
"""Libraries without a build for every system and Python, and what that means."""


def check_environment(pdal: Path | None = None) -> dict[str, Any]:
    """Versions and places of what the engine uses.

    Raises:
        InputError: a library is missing, or the PDAL that was asked for does not start.
    """
    found: dict[str, Any] = {**versions(), "interpreter": sys.executable}
    for name in LIBRARIES:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise InputError(
                f"The Python library {name} cannot be imported ({error}); set the engine up again, with Repair."
            ) from error
    for name, without in OPTIONAL.items():
        try:
            importlib.import_module(name)
        except ImportError:
            found[name] = without
    try:
        found["torch"] = importlib.metadata.version("torch")
    except importlib.metadata.PackageNotFoundError:
        found["torch"] = "not installed"
    found["screening_weights"] = SHIPPED_SHA256[:12] if SHIPPED_WEIGHTS.is_file() else "not there"
    found["relief_weights"] = RELIEF_SHA256[:12] if RELIEF_WEIGHTS.is_file() else "not there"
    program = find_pdal(pdal)
    found["pdal"] = program.version or f"none; {CLIPPED_BY} clip clouds instead"
    found["pdal_path"] = program.path
    found["pdal_found_by"] = program.how
    found["qgis_process"] = shutil.which("qgis_process") or "not on PATH"
    return found

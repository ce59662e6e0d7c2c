"""The clouds that an extraction writes: all points with their classes, and the ground alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Bool
from ..pointcloud import plant_cover
from ..pointcloud.writing import Copy
from .filtering import Filtered, vertical
from .pdal_pipelines import GROUND, UNCLASSIFIED
from .result import HEIGHT_OVER_GROUND

Dimensions = dict[str, NDArray[np.float32]]


def labelled(outputs: tuple[Path, Path], keep: Bool, ground: Bool, dimensions: Dimensions) -> tuple[Copy, Copy]:
    """All points that are kept with their classes, and the ground alone.

    Args:
        outputs: the classified and the ground cloud.
        keep: (n,) which of the source's points.
        ground: (m,) which of those kept.
        dimensions: extra dimensions (m,) of those kept.
    """
    labels = np.where(ground, GROUND, UNCLASSIFIED).astype(np.uint8)
    chosen = keep.copy()
    chosen[keep] = ground
    of_ground = {name: values[ground] for name, values in dimensions.items()}
    return (
        Copy(outputs[0], keep, dimensions=dimensions, classification=labels),
        Copy(outputs[1], chosen, dimensions=of_ground, classification=labels[ground]),
    )


def plant_dimensions(found: Filtered, dip: float) -> Dimensions:
    """What is known of the plants at each point, as the file holds it: vertical metres; nothing without refinement."""
    upright = vertical(dip)  # distances are square to the slope's plane
    named = {
        HEIGHT_OVER_GROUND: found.height,
        plant_cover.ERROR: found.plant_error,
        plant_cover.HEIGHT: found.plant_height,
    }
    return {name: (values * upright).astype(np.float32) for name, values in named.items() if values is not None}

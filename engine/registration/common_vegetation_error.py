"""The error that vegetation leaves to a registration: the part that a whole slope shares, by season.

The error of a height by vegetation has a part that differs from place to place, and one that the whole slope shares.
The first is in the residuals of the registration, and so in its covariance. The second looks like an offset of the
survey. Vegetation of one season and one density shifts both surveys alike, and the shift cancels.
"""

from __future__ import annotations

import math

import numpy as np

from ..core.arrays import Float
from ..geometry.pose import Pose
from ..pointcloud.plant_cover import MIN_HEIGHT_DIFFERENCE_M
from .point_to_plane import Matcher
from .surface import Surface

SHARED = 0.6
"""Share of the stated error by vegetation that a whole slope shares: the mean error of six ground clouds of forest
strips against the vendors' ground is 0.12 to 0.62 of it. Sparse simulated grass shows 0.8 to 1.3. By 0.3 and 0.9 the
error of another season is stated as 0.6 and 1.6 of the true one, by 0.6 as 1.1; within a season it hardly counts."""


def common_vegetation_error(matcher: Matcher, pose: Pose, places: Float) -> float:
    """Standard error of the registration's height, metres, by the vegetation over ``places`` (n, 3; after it).

    With the mean stated errors a and b of the two surveys it is the shared part of sqrt(a² + b² - 2 r a b). The
    correlation r is 1 in one season, where the mean heights of the vegetation differ by no more than 5 cm. Else it is
    the ratio of the lower to the taller one: 0.2 where grass of 25 cm was mown to 5 cm. It is 0 where a cloud does not
    record heights.
    """
    if not len(places):
        return 0.0
    first = _means(matcher.reference, places)
    second = _means(matcher.moving, pose.undo(places))
    low, high = sorted((first[1], second[1]))
    alike = low / high if high > 0 else 0.0
    if low > 0 and high - low <= MIN_HEIGHT_DIFFERENCE_M:
        alike = 1.0
    squares = first[0] ** 2 + second[0] ** 2 - 2.0 * alike * first[0] * second[0]
    return SHARED * math.sqrt(max(squares, 0.0))


def _means(surface: Surface, places: Float) -> tuple[float, float]:
    """Mean error by vegetation and mean height of the vegetation at the places, metres; 0 where not known."""
    near = np.asarray(surface.tree.query(places, workers=-1)[1])
    error, height = (
        0.0 if values is None else float(np.mean(values[near])) for values in (surface.plants, surface.plant_heights)
    )
    return error, height

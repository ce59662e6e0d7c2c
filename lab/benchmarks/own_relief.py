"""How much a slope's own relief looks like a hazard: what no screening of a single survey can distinguish by height.

At random places the shape of a known hazard is fitted to the untouched ground together with a smooth background. Its
fitted height would be 0 on even ground; on a real slope it is the height of bulges and hollows that the slope has
anyhow. A screening that knew place, size and shape could do no better by height than to set a threshold on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...engine.core.arrays import Float
from ...engine.geometry.dominant_plane import apply_matrix
from ...engine.geometry.hazard_shapes import displacement_at, reach
from ...engine.statistics.robust import nmad
from ...simulation.hazard_scenes.known_hazards import Site, put_hazards

AROUND = 1.5
"""Width (m) of the untouched ground around a hazard that takes part in the fit."""
TURNS = 5
TUKEY = 4.685


@dataclass(frozen=True)
class OwnRelief:
    """``heights`` (n,): what the shape's fit finds on the untouched ground (m), at n places."""

    diameter: float
    heights: Float

    @property
    def spread(self) -> float:
        """Half of the interval (m) that holds the middle 68 % of the heights."""
        low, high = np.percentile(self.heights, (16, 84))
        return float(high - low) / 2

    def standing_out(self, height: float, false: float) -> float:
        """Share of hazards of ``height`` m that stand out where a share ``false`` of untouched places does, too."""
        threshold = np.quantile(np.abs(self.heights), 1.0 - false)
        up, down = self.heights + abs(height), self.heights - abs(height)
        return float(np.mean(np.concatenate([up > threshold, down < -threshold])))


def own_relief(xyz: Float, diameter: float, site: Site | None = None, seeds: int = 40) -> OwnRelief:
    """Measure the relief of ground points (n, 3) at the places where ``put_hazards`` would put hazards.

    Args:
        seeds: how often up to three places are drawn.

    Raises:
        InputError: the plane of the slope cannot be found.
    """
    found = []
    flat, tree = None, None
    for seed in range(seeds):
        scene = put_hazards(xyz, [(1.0, diameter)] * 3, seed, site=site)
        if flat is None or tree is None:
            flat = apply_matrix(scene.matrix, xyz)
            tree = cKDTree(flat[:, :2])
        for hazard in scene.shapes:
            near = flat[tree.query_ball_point((hazard.u, hazard.w), reach(hazard) + AROUND)]
            shape = displacement_at(hazard, near[:, 0], near[:, 1])
            found.append(fitted_height(near - [hazard.u, hazard.w, 0.0], shape))
    return OwnRelief(diameter, np.array(found))


def fitted_height(points: Float, shape: Float) -> float:
    """Height (m) of a ``shape`` (n,) of unit height in points (n, 3) that otherwise lie on a quadratic surface.

    Least squares, reweighted by Tukey's biweight of the residuals (Beaton and Tukey 1974).
    """
    x, y, z = points.T
    columns = np.column_stack([shape, np.ones_like(x), x, y, x * x, x * y, y * y])
    weight = np.ones(len(z))
    solution = np.zeros(columns.shape[1])
    for _ in range(TURNS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(columns * root[:, None], z * root, rcond=None)[0]
        residual = np.abs(z - columns @ solution)
        scale = max(nmad(residual, 0.0), 1e-6)
        weight = (1.0 - np.minimum(residual / (TUKEY * scale), 1.0) ** 2) ** 2
    return float(solution[0])

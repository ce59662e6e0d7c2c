"""Simulated and real plants: how high the returns lie over the ground, and how many are of it.

Heights of simulated points are over the true ground; those of real ones, and of the simulated forest where it is
compared with its example, over a plane through the eight nearest points of the vendor's ground (of the true ground).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...engine.core.arrays import Bool, Float
from ...interface.parameters import SurveyParameters
from ...simulation.surveys.plot import Plot, grass_plot, plot
from .real_data import DATA
from .table import Row

SEEDS = (1, 2, 3)
NEAR = 0.05
"""Returns within so many metres of the ground count as having passed the plants."""
NEIGHBOURS = 8
NOISE_CLASSES = (7, 18)
REAL = {
    "native forest, New Zealand (coromandel_forest)": "terrain/coromandel_forest.laz",
    "forest, British Columbia (british_columbia_forest)": "terrain/british_columbia_forest.laz",
    "forest, French Alps (chablais_forest)": "terrain/chablais_forest.laz",
    "alpine meadow and shrubs (alpine_slope)": "real/ign_tiles/alpine_slope.laz",
    "trees next to open ground (IGN 77050_627755)": "real/ign_tiles/test_data_77050_627755_LA93_IGN69.laz",
    "open ground and trees (IGN 77050_627760)": "real/ign_tiles/test_data_77050_627760_LA93_IGN69.laz",
}
FOREST_EXAMPLE = next(iter(REAL))
PUBLISHED_GRASS = "median 0.20 to 0.27, 90 % 0.42 to 0.55, 99 % 0.65 to 0.88 m; ground 2 to 8 %; about 700 returns/m²"
"""UAV LiDAR of grassland, plots of 10 by 10 m: heights over the vendor's ground and its share."""
BARE = SurveyParameters(vegetation=0.0)
QUANTILES = (0.05, 0.5, 0.9, 0.99)


@dataclass(frozen=True)
class Returns:
    """What is known of a cloud's returns: ``above`` the ground (n,), m, which are of it (n,), and the numbers."""

    above: Float
    ground: Bool
    number: NDArray[np.uint8]
    area: float

    @property
    def quantiles(self) -> Float:
        """Heights below which QUANTILES of the returns lie, m."""
        return np.quantile(self.above, QUANTILES)

    @property
    def ground_share(self) -> float:
        return float(self.ground.mean())

    def text(self) -> str:
        """The figures in one line."""
        low, median, most, nearly = self.quantiles
        return (
            f"5 % {low:.2f}, median {median:.2f}, 90 % {most:.2f}, 99 % {nearly:.2f} m; "
            f"ground {100 * self.ground_share:.1f} %, within {100 * NEAR:g} cm "
            f"{100 * float((np.abs(self.above) <= NEAR).mean()):.1f} %; "
            f"{1 / float((self.number == 1).mean()):.2f} a pulse; {len(self.above) / self.area:.0f}/m²"
        )


def height_over_ground(xyz: Float, ground: Bool) -> Float:
    """Height (n,) of points (n, 3) over the plane through the ``NEIGHBOURS`` nearest (in plan) of those in ``ground``.

    Points of the ground itself lie near 0. Needs as many points of the ground as neighbours.
    """
    return over_ground_planes(xyz, ground)[0]


def over_ground_planes(xyz: Float, ground: Bool) -> tuple[Float, Float]:
    """Height (n,) over the plane as in ``height_over_ground``, m, and that plane's slope (n,), degrees."""
    base = xyz[ground]
    tree = cKDTree(base[:, :2])
    above, slope = np.empty(len(xyz)), np.empty(len(xyz))
    for start in range(0, len(xyz), 50_000):
        part = slice(start, start + 50_000)
        _, index = tree.query(xyz[part, :2], k=NEIGHBOURS)
        offset = base[index] - xyz[part, None, :]
        middle = offset.mean(axis=1)
        offset -= middle[:, None, :]
        normal = np.einsum("nki,nkj->nij", offset[..., :2], offset[..., :2])
        # Neighbours in one line leave the tilt across it open: none.
        normal += 1e-9 * np.eye(2)
        tilt = np.linalg.solve(normal, np.einsum("nki,nk->ni", offset[..., :2], offset[..., 2])[..., None])[..., 0]
        above[part] = (tilt * middle[:, :2]).sum(axis=1) - middle[:, 2]
        slope[part] = np.degrees(np.arctan(np.hypot(*tilt.T)))
    return above, slope


def returns_of(made: Plot, side: float) -> Returns:
    """Of a simulated plot, over its true ground."""
    cloud = made.cloud
    return Returns(made.above, cloud.truth_ground == 1, cloud.return_number, side**2)


def fitted(made: Plot, side: float) -> Returns:
    """Of a simulated plot, over planes through its true ground points: as real clouds are measured."""
    known = returns_of(made, side)
    return replace(known, above=height_over_ground(made.cloud.xyz, known.ground))


def real(path: Path) -> Returns:
    """Of a classified cloud, without the points that its vendor calls noise; area is that of 2 m cells with points."""
    las = laspy.read(path)
    kept = ~np.isin(np.asarray(las.classification), NOISE_CLASSES)
    xyz = np.array(las.xyz)[kept]
    ground = np.asarray(las.classification)[kept] == 2
    cells = len(np.unique(np.floor(xyz[:, :2] / 2.0).astype(np.int64), axis=0))
    return Returns(height_over_ground(xyz, ground), ground, np.asarray(las.return_number)[kept], 4.0 * cells)


def real_returns() -> dict[str, Returns]:
    """Those of ``REAL`` whose files are there."""
    return {name: real(DATA / path) for name, path in REAL.items() if (DATA / path).is_file()}


def lowest(made: Plot, cell: float, share: float) -> float:
    """Mean over square cells of the height (m) below which ``share`` of a cell's returns lie; cells of 20 or more."""
    place = np.floor(made.cloud.xyz[:, :2] / cell).astype(np.int64)
    _, index, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((made.above, index.ravel()))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    taken = first + np.minimum((share * count).astype(np.int64), count - 1)
    return float(made.above[order][taken][count >= 20].mean())


def grass(state: str, side: float = 10.0, density: float = 700.0) -> Returns:
    """Plots of SEEDS together."""
    parts = [returns_of(grass_plot(seed, side, density, state), side) for seed in SEEDS]
    return Returns(
        np.concatenate([part.above for part in parts]),
        np.concatenate([part.ground for part in parts]),
        np.concatenate([part.number for part in parts]),
        sum(part.area for part in parts),
    )


def rows() -> list[Row]:
    grown, mown = grass("grown"), grass("mown")
    thin = grass("grown", 30.0, 40.0)
    ferns = returns_of(plot(replace(BARE, ferns=1.0), 15.0, 150.0, 30.0), 15.0)
    forest = plot(replace(BARE, forest=1.0), 60.0, 32.0, 38.0)
    examples = real_returns()
    table = [
        _row("closed grass, grown, 3 plots", grown, PUBLISHED_GRASS, like_grass(grown), "the target is of real grass"),
        _row("the same in a thin survey", thin, "the same heights; 20 to 60 returns/m²", like_grass(thin)),
        _row("closed grass, mown, 3 plots", mown, "ground 20 to 50 %", 0.2 <= mown.ground_share <= 0.5),
        _row("ferns and low shrubs that close", ferns, "ground 1 to 4 %", 0.01 <= ferns.ground_share <= 0.04),
        _row(
            "native forest, 38 degrees, over planes through its ground",
            fitted(forest, 60.0),
            "ground about 1 in 60",
            1 / 80 <= float((forest.cloud.truth_ground == 1).mean()) <= 1 / 45,
            f"over the true ground: {returns_of(forest, 60.0).text()}",
        ),
    ]
    table.append(_lowest_row())
    return table + [_row(f"real: {name}", found) for name, found in examples.items()]


def _lowest_row() -> Row:
    """What the lowest returns are in grown grass: what is left of the ground for any filter to find."""
    made = [grass_plot(seed) for seed in SEEDS]
    wide, narrow = (float(np.mean([lowest(m, *how) for m in made])) for how in ((0.5, 0.01), (0.25, 0.03)))
    return Row(
        "grown grass: height of the lowest 1 % of cells of 0.5 m, of the lowest 3 % of cells of 0.25 m",
        f"{wide:+.3f} m, {narrow:+.3f} m",
        "",
        "real plots: -0.01 to 0.00 m, +0.02 to +0.05 m",
    )


def like_grass(found: Returns) -> bool:
    """Whether heights and share of the ground lie within those of real grass."""
    _, median, most, nearly = found.quantiles
    return bool(
        0.20 <= median <= 0.27
        and 0.42 <= most <= 0.55
        and 0.65 <= nearly <= 0.88
        and 0.02 <= found.ground_share <= 0.08
    )


def _row(figure: str, found: Returns, target: str = "", met: bool | None = None, peer: str = "") -> Row:
    return Row(figure, found.text(), target, peer, met)

"""Clouds whose ground is known: real ones with a vendor's ground, simulated plots with the true surface.

What a method may see of a cloud (``Seen``) is kept apart from what is known of it, so that no label reaches a method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Bool, Float
from ...engine.pointcloud.returns import last_returns
from ...simulation.surveys.plot import Plot, grass_plot, plot
from .plants import BARE, over_ground_planes
from .real_data import DATA

SEEDS = (1, 2, 3)
VENDORS_GROUND = 2
SLOPE_STEP = 0.25
"""The true surface's slope is measured so far (m) to each side."""
DENSITY_CELL = 2.0
THIN = 100.0
"""Plots of so many returns a m² and fewer are larger."""


@dataclass(frozen=True)
class Seen:
    """Coordinates (n, 3), m, number of each return and of the returns of its pulse (n,). ``platform``: ALS or ULS."""

    xyz: Float
    number: NDArray[np.uint8]
    total: NDArray[np.uint8]
    platform: str

    @property
    def last(self) -> Bool:
        """(n,) the last returns; all where the numbers make no sense."""
        return last_returns(self.number, self.total).last

    @property
    def density(self) -> float:
        """Returns a m² in the cell of 2 m of half of the returns, at least: cells at the edge count little."""
        place = np.floor(self.xyz[:, :2] / DENSITY_CELL).astype(np.int64)
        _, cell, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
        return float(np.median(count[cell.ravel()])) / DENSITY_CELL**2


@dataclass(frozen=True)
class Cloud:
    """A cloud and what is known of it.

    ``above`` (n,) is the height over the reference surface, m, ``slope`` (n,) that surface's, degrees, ``ground`` (n,)
    which points are ground by the vendor's or the simulation's word, ``pulse`` (n,) which pulse each belongs to.
    """

    seen: Seen
    above: Float
    slope: Float
    ground: Bool
    pulse: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.above)

    def part(self, kept: Bool) -> Cloud:
        """The points in ``kept`` (n,)."""
        seen = replace(self.seen, xyz=self.seen.xyz[kept], number=self.seen.number[kept], total=self.seen.total[kept])
        return Cloud(seen, self.above[kept], self.slope[kept], self.ground[kept], self.pulse[kept])

    def thinned(self, share: float, seed: int = 1) -> Cloud:
        """A share of the pulses, drawn at random; smaller shares of a seed are parts of larger ones."""
        _, pulse = np.unique(self.pulse, return_inverse=True)
        count = int(pulse.max()) + 1
        rank = np.random.default_rng(seed).permutation(count)
        return self.part(rank[pulse] < round(share * count))


@dataclass(frozen=True)
class Case:
    """Clouds measured together under one name. ``file`` is that of a real one, relative to the shared data."""

    name: str
    title: str
    make: Callable[[], tuple[Cloud, ...]]
    file: str = ""

    @property
    def simulated(self) -> bool:
        return not self.file

    @property
    def missing(self) -> bool:
        """Whether its file is not there."""
        return bool(self.file) and not (DATA / self.file).is_file()


def pulses(time: Float, source: NDArray, number: NDArray, total: NDArray) -> NDArray[np.int64]:
    """Which pulse (n,) each return belongs to, from GPS times, sources and return numbers (n,).

    Where several pulses of one source share a time, as in files with coarse clocks, the k-th of their first returns
    goes with the k-th of their second ones, in the order of the file.
    """
    keys = np.column_stack([time, source, total, number]).astype(np.float64)
    order = np.lexsort((np.arange(len(time)), number, total, source, time))
    starts = np.append(True, (np.diff(keys[order], axis=0) != 0).any(axis=1))
    position = np.arange(len(time))
    rank = np.empty(len(time))
    rank[order] = position - np.maximum.accumulate(np.where(starts, position, 0))
    _, pulse = np.unique(np.column_stack([keys[:, :3], rank]), axis=0, return_inverse=True)
    return pulse.ravel().astype(np.int64)


def real_cloud(path: Path) -> Cloud:
    """A file with a vendor's ground: heights are over the plane through its eight nearest points of class 2."""
    las = laspy.read(path)
    number, total = np.array(las.return_number, dtype=np.uint8), np.array(las.number_of_returns, dtype=np.uint8)
    xyz, ground = np.array(las.xyz), np.asarray(las.classification) == VENDORS_GROUND
    above, slope = over_ground_planes(xyz, ground)
    pulse = pulses(np.array(las.gps_time), np.asarray(las.point_source_id), number, total)
    return Cloud(Seen(xyz, number, total, "ALS"), above, slope, ground, pulse)


def simulated_cloud(made: Plot) -> Cloud:
    """A simulated plot: heights are over the true surface."""
    cloud, height = made.cloud, made.true_height
    x, y = cloud.xyz[:, 0], cloud.xyz[:, 1]
    along = (height(x + SLOPE_STEP, y) - height(x - SLOPE_STEP, y)) / (2 * SLOPE_STEP)
    across = (height(x, y + SLOPE_STEP) - height(x, y - SLOPE_STEP)) / (2 * SLOPE_STEP)
    return Cloud(
        Seen(cloud.xyz, cloud.return_number, cloud.number_of_returns, "ULS"),
        made.above,
        np.degrees(np.arctan(np.hypot(along, across))),
        cloud.truth_ground == 1,
        pulses(cloud.gps_time, cloud.line, cloud.return_number, cloud.number_of_returns),
    )


def _real(name: str, title: str, file: str) -> Case:
    return Case(name, title, lambda: (real_cloud(DATA / file),), file)


def _simulated(name: str, title: str, make: Callable[[int], Plot]) -> Case:
    return Case(name, f"simulated {title}, {len(SEEDS)} plots", lambda: tuple(simulated_cloud(make(s)) for s in SEEDS))


def _grass(state: str, density: float) -> Case:
    side = 10.0 if density > THIN else 20.0
    return _simulated(
        f"grass_{state}_{density:g}",
        f"grass, {state}, {density:g}/m²",
        lambda seed: grass_plot(seed, side, density, state),
    )


CASES = (
    _real("coromandel_forest", "native forest, New Zealand (coromandel_forest)", "terrain/coromandel_forest.laz"),
    _simulated(
        "native_forest",
        "native forest, 38 degrees, 32/m²",
        lambda seed: plot(replace(BARE, forest=1.0, seed=seed), 60.0, 32.0, 38.0),
    ),
    _real(
        "british_columbia_forest",
        "forest, British Columbia (british_columbia_forest)",
        "terrain/british_columbia_forest.laz",
    ),
    _real("chablais_forest", "forest, French Alps (chablais_forest)", "terrain/chablais_forest.laz"),
    _real("alpine_slope", "alpine meadow and shrubs (alpine_slope)", "real/ign_tiles/alpine_slope.laz"),
    _real(
        "test_data_77050_627755",
        "trees next to open ground (IGN 77050_627755)",
        "real/ign_tiles/test_data_77050_627755_LA93_IGN69.laz",
    ),
    _real(
        "test_data_77050_627760",
        "open ground and trees (IGN 77050_627760)",
        "real/ign_tiles/test_data_77050_627760_LA93_IGN69.laz",
    ),
    _grass("grown", 700.0),
    _grass("mown", 700.0),
    _grass("grown", 40.0),
    _grass("mown", 40.0),
    _simulated(
        "ferns",
        "ferns and low shrubs that close, 150/m²",
        lambda seed: plot(replace(BARE, ferns=1.0, seed=seed), 15.0, 150.0, 30.0),
    ),
)

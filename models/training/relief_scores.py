"""How good a network on relief is on labelled slopes: points, hazards and zones by the decision of screening."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ...engine.core.arrays import Float, Float32, Index
from ...engine.core.progress import Progress
from ...interface.parameters import AUTO, ScreeningParameters
from ..configuration import CLASSES
from ..inference.baseline import residual_configuration
from ..inference.calibration_bins import calibration_bins
from ..preparation.bump_filter import CellHeights, cell_heights
from ..preparation.inserted_hazards import BACKGROUND, SUBSIDENCE, UPLIFT
from ..preparation.prepare import UNKNOWN, flat_frame
from ..preparation.raster_zones import MIN_AREA_M2, PER_M2, zones_above
from ..preparation.relative_scores import level_for
from ..preparation.relief_raster import CELL_M, MAX_GAP_M, relief_raster
from ..preparation.streaming import sample_parts, sum_parts
from ..screening.detectability import PART_M
from ..screening.labels import zone_labels
from ..screening.relief import ReliefModel
from .evaluation import confusion, rounded
from .own_data import Labels, OwnCloud
from .relief_patches import cell_labels
from .tuning import TunedScores

_SCREENING = ScreeningParameters(screening_method="relief")
"""Zones are those that screening shows when nothing else is asked for."""
_MIN_PROBABILITY = 1e-30


@dataclass(frozen=True)
class LabelledRaster:
    """A labelled slope as screening lays it out.

    ``cells`` are what the network's channels are made of; ``column`` and ``row`` (n,) are each point's cell; ``labels``
    (columns, rows) are the cells' classes (see ``relief_patches.cell_labels``), ``nearby`` those of the nearest cell
    with points, 255 farther from one than ground reaches.
    """

    cells: CellHeights
    column: Index
    row: Index
    labels: Labels
    nearby: Labels


def labelled_raster(cloud: OwnCloud) -> LabelledRaster:
    """Lay a cloud out.

    Raises:
        InputError: too few points, or the plane cannot be found.
    """

    def whole() -> Iterable[Float]:
        yield cloud.xyz

    _, matrix = flat_frame(sample_parts(whole, cloud.name).xyz, residual_configuration(PART_M))
    voxels = sum_parts(whole, matrix, PART_M, spread=True)
    points, count = voxels.grid.points, voxels.grid.count
    raster = relief_raster(points, (), CELL_M, count)
    cells = cell_heights(points, raster.cell, raster.origin, raster.shape, count, voxels.spread)
    column, row = (index[voxels.lookup(cloud.xyz)] for index in raster.index(points))
    labels = cell_labels(column, row, cloud.labels, raster.shape)
    away, near = distance_transform_edt(~cells.covered, return_indices=True)
    nearby = np.where(away * cells.cell <= MAX_GAP_M, labels[near[0], near[1]], UNKNOWN).astype(np.uint8)
    return LabelledRaster(cells, column, row, labels, nearby)


@dataclass(frozen=True)
class ZoneFigures:
    """``hazards`` of at least 1 m² that are labelled, how many of them were ``found``, and ``false_zones`` on so much
    ``background``, m².

    A hazard is a group of connected cells of one class. It is found where a zone of its class covers a quarter of it or
    1 m². A zone is false where none of its cells is labelled as its class and at least half of them are labelled.
    """

    hazards: int = 0
    found: int = 0
    false_zones: int = 0
    background: float = 0.0

    def __add__(self, other: ZoneFigures) -> ZoneFigures:
        return ZoneFigures(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def summary(self) -> dict[str, Any]:
        """By name, with the share of the hazards that was found and false zones per 1,000 m², ready for JSON."""
        recall = self.found / self.hazards if self.hazards else np.nan
        rate = PER_M2 * self.false_zones / self.background if self.background else np.nan
        return {
            "hazards": self.hazards,
            "hazards_found": self.found,
            "hazard_recall": rounded(recall),
            "false_zones": self.false_zones,
            "background_m2": round(self.background, 2),
            "false_zones_per_1000_m2": rounded(rate),
        }

    @classmethod
    def of(cls, values: dict[str, Any]) -> ZoneFigures:
        """The figures that ``summary`` wrote."""
        names = ("hazards", "hazards_found", "false_zones", "background_m2")
        return cls(*(values[name] for name in names))


def zone_figures(decided: Labels, truth: Labels, cell: float) -> ZoneFigures:
    """How zones, given as classes of cells (columns, rows), agree with labels of the same cells, 255 unknown."""
    hazards = found = false = 0
    for kind in (UPLIFT, SUBSIDENCE):
        zones, count = zones_above((decided == kind).astype(np.float32), 0.5, cell)
        real, wanted = zones_above((truth == kind).astype(np.float32), 0.5, cell)
        pairs = np.bincount((real * (count + 1) + zones).ravel(), minlength=(wanted + 1) * (count + 1))
        common = pairs.reshape(wanted + 1, count + 1)[1:, 1:] * cell**2
        area = np.bincount(real.ravel(), minlength=wanted + 1)[1:] * cell**2
        hazards += wanted
        found += int((common.max(axis=1, initial=0.0) >= np.minimum(MIN_AREA_M2, 0.25 * area) - 1e-9).sum())
        size, known, own = (
            np.bincount(zones[where], minlength=count + 1)[1:]
            for where in (np.ones(zones.shape, dtype=bool), truth != UNKNOWN, truth == kind)
        )
        false += int(((own == 0) & (2 * known >= size)).sum())
    return ZoneFigures(hazards, found, false, float(np.count_nonzero(truth == BACKGROUND)) * cell**2)


@dataclass(frozen=True)
class Screened:
    """What screening by some weights says of a labelled slope: ``decided`` classes (columns, rows) of the cells and
    their ``probabilities`` (3, columns, rows).
    """

    decided: Labels
    probabilities: Float32

    def of_points(self, raster: LabelledRaster) -> tuple[Labels, Float32]:
        """(n,) classes and (n, 3) probabilities of the points."""
        return self.decided[raster.column, raster.row], self.probabilities[:, raster.column, raster.row].T


def relief_screening(weights: Path, threads: int | str = AUTO, device: str = "cpu") -> ReliefModel:
    """The network on relief of these weights, as screening runs it."""
    return ReliefModel(
        ScreeningParameters(screening_method="relief", weights=str(weights), threads=threads, device=device)
    )


def screened(model: ReliefModel, raster: LabelledRaster, progress: Progress | None = None) -> Screened:
    """Decide on the cells of a slope as screening does by default."""
    found = model.found(raster.cells, progress or Progress())
    level, least = level_for(_SCREENING.false_zones), _SCREENING.minimum_probability
    return Screened(zone_labels(found.scores, level, found.probabilities, least), found.probabilities)


def held_out_cells(
    raster: LabelledRaster, probabilities: Float32, most: int, rng: np.random.Generator
) -> tuple[NDArray[np.float32], Labels, NDArray[np.float64]]:
    """Log odds (n, 2) of both hazards against the background, classes (n,) and weights (n,) of at most so many cells
    with a label; the weights add up to the number of all.
    """
    chosen = np.flatnonzero((raster.cells.covered & (raster.labels != UNKNOWN)).ravel())
    kept = rng.permutation(chosen)[:most]
    logarithms = np.log(
        np.maximum(probabilities.reshape(len(CLASSES), -1)[:, kept].astype(np.float64), _MIN_PROBABILITY)
    )
    weights = np.full(len(kept), len(chosen) / max(1, len(kept)))
    return (logarithms[1:] - logarithms[0]).T.astype(np.float32), raster.labels.ravel()[kept], weights


@dataclass
class ReliefScores(TunedScores):
    """Scores of held-out slopes by points and by zones; ``start_zones`` are those of the weights started from."""

    zones: ZoneFigures = field(default_factory=ZoneFigures)
    start_zones: ZoneFigures = field(default_factory=ZoneFigures)

    def add(self, cloud: OwnCloud, raster: LabelledRaster, found: Screened) -> None:
        """Score what was said of a slope."""
        decided, probabilities = found.of_points(raster)
        self.counts += confusion(cloud.labels[cloud.known], decided[cloud.known])
        self.bins += calibration_bins(cloud.labels[cloud.known], probabilities[cloud.known])
        self.scenes += 1
        self.zones += zone_figures(found.decided, raster.nearby, raster.cells.cell)

    def add_start(self, cloud: OwnCloud, raster: LabelledRaster, found: Screened) -> None:
        """Score what the weights started from say of the same slope."""
        decided, _ = found.of_points(raster)
        counts = confusion(cloud.labels[cloud.known], decided[cloud.known])
        self.start = counts if self.start is None else self.start + counts
        self.start_zones += zone_figures(found.decided, raster.nearby, raster.cells.cell)

    def summary(self) -> dict[str, Any]:
        """As ``TunedScores.summary``, with ``zones`` and, with weights to start from, ``start_zones``."""
        start = None if self.start is None else self.start_zones.summary()
        return {**super().summary(), "zones": self.zones.summary(), "start_zones": start}


def pooled_zones(results: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """Hazards found and false zones over all folds, from their summaries; those of the start under ``start_*``."""
    results = list(results)
    pooled = sum((ZoneFigures.of(result["zones"]) for result in results), ZoneFigures()).summary()
    if all(result["start_zones"] is not None for result in results):
        before = sum((ZoneFigures.of(result["start_zones"]) for result in results), ZoneFigures()).summary()
        pooled |= {f"start_{name}": value for name, value in before.items()}
    return pooled

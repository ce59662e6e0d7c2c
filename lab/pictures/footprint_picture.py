"""The picture in docs/guide.md of the footprints over which volumes are taken.

``lab/pictures/footprint_picture.py [FILE]`` draws two changes that are known, measured with noise and gaps:
the zones, their footprints and the true outlines, with the volumes of each.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from scipy import ndimage
from slopewatch.engine.grid.grid import Grid
from slopewatch.engine.grid.partition import Partition
from slopewatch.engine.maps.palette import diverging_colours
from slopewatch.engine.statistics.normal import Z95
from slopewatch.engine.zones.extraction import extract_zones
from slopewatch.engine.zones.footprints import Cells, Detected, footprint_labels

CELL, ROWS, COLUMNS = 0.1, 90, 180
ERROR, REGISTRATION = 0.035, 0.002
LIMIT = 0.25
BOWLS = ((4.4, 4.6, 2.6, -0.20), (13.2, 4.4, 3.2, 0.14))  # x, y, radius, height in metres


def main(path: Path) -> None:
    """Simulate, compute, draw."""
    random = np.random.default_rng(5)
    x, y = np.meshgrid((np.arange(COLUMNS) + 0.5) * CELL, (np.arange(ROWS) + 0.5) * CELL)
    truth = np.zeros((ROWS, COLUMNS))
    for east, south, radius, height in BOWLS:
        truth += height * np.maximum(1 - ((x - east) ** 2 + (y - south) ** 2) / radius**2, 0) ** 2
    gaps = ndimage.gaussian_filter(random.normal(size=truth.shape), 1.5)
    dz = truth + ERROR * random.normal(size=truth.shape) + REGISTRATION * random.normal()
    dz[gaps < np.quantile(gaps, 0.35)] = np.nan
    error = np.where(np.isfinite(dz), np.hypot(ERROR, REGISTRATION), np.nan)
    with np.errstate(invalid="ignore"):
        significant = np.abs(dz) > Z95 * error
    grid = Grid(0.0, 0.0, CELL, ROWS, COLUMNS)
    cells = Cells(dz, error, np.full(dz.shape, CELL**2), Partition(grid.shape, CELL))
    detected = Detected(significant, Z95 * error, np.full(dz.shape, 5))
    found = extract_zones(cells, detected, grid, None, registration_error=REGISTRATION)
    draw(path, dz, truth, found.labels, footprint_labels(found.footprints, dz.shape), found.volumes)


def draw(path: Path, dz, truth, labels, footprints, volumes) -> None:  # type: ignore[no-untyped-def]
    figure = Figure(figsize=(11, 3.9), layout="constrained")
    extent = (0, COLUMNS * CELL, ROWS * CELL, 0)
    colours = ListedColormap(diverging_colours(np.linspace(-1.0, 1.0, 256), 1.0) / 255.0)
    for axes, title in zip(figure.subplots(1, 2), ("the zones' own cells", "the footprints"), strict=True):
        own = title != "the footprints"
        chosen = labels if own else footprints
        axes.imshow(np.full((*dz.shape, 3), 225, dtype=np.uint8), extent=extent)
        image = axes.imshow(dz, cmap=colours, vmin=-LIMIT, vmax=LIMIT, extent=extent, interpolation="nearest")
        centres = (np.arange(COLUMNS) + 0.5) * CELL, (np.arange(ROWS) + 0.5) * CELL
        axes.contour(*centres, chosen > 0, [0.5], colors="black", linewidths=0.5 if own else 1.5)
        for number in range(1, labels.max() + 1):
            middle = np.nonzero(footprints == number)[1].mean() * CELL
            near = np.abs(np.arange(COLUMNS) * CELL - middle) < 4.0
            true = truth[:, near].sum() * CELL**2
            own_volume = np.nansum(dz[labels == number]) * CELL**2
            text = (
                f"{own_volume:+.2f} m³"
                if own
                else f"{volumes.net[number - 1]:+.2f} ± {volumes.error[number - 1]:.2f} m³"
            )
            axes.text(middle, ROWS * CELL - 0.3, f"{text}, true {true:+.2f}", ha="center", fontsize=10)
        axes.set(title=f"Volume over {title}", xlabel="metres", xlim=(0, 18), ylim=(9, 0))
        axes.set_aspect("equal")
    figure.colorbar(image, ax=figure.axes, label="measured change (m); grey: no data", shrink=0.7)
    figure.savefig(path, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/footprints.png"))

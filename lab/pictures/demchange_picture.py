"""The picture in docs/dem_change.md: what a change between elevation models takes off, and what it leaves.

``lab/pictures/demchange_picture.py [FILE]`` compares two surveys of a gully (2012, 2016) and two of a park
(2015, 2023), of which the second was delivered in another vertical datum: difference as it came, change with bias and
shift taken off, level of detection, significance.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from PIL import Image
from slopewatch.engine.core.arrays import Float
from slopewatch.engine.elevation_models.comparison import compare_models
from slopewatch.engine.elevation_models.model import read_model
from slopewatch.engine.maps.palette import diverging_colours
from slopewatch.lab.benchmarks.demchange import FOLDER
from slopewatch.lab.pictures.small_jpeg import BYTES

PAIRS = (
    ("gully, 2012 to 2016", "fort_bragg_gully", (2012, 2016), 0.4),
    ("park, 2015 to 2023", "toronto_park", (2015, 2023), 0.6),
)
_DPI = (130, 115, 105, 95, 85)
_STEPS = 112  # of each of the two ramps in the picture's 256 colours
STYLE = {"axes.titlelocation": "left", "axes.titlesize": 9, "xtick.labelsize": 7, "ytick.labelsize": 7}


def main(path: Path) -> None:
    """Compare and draw."""
    colours = ListedColormap(diverging_colours(np.linspace(-1.0, 1.0, 256), 1.0) / 255.0)
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 7.0), layout="constrained")
        for axes, (title, name, years, limit) in zip(figure.subplots(2, 4), PAIRS, strict=True):
            first, second = (read_model(FOLDER / f"{name}_{year}.tif") for year in years)
            found = compare_models(first.heights, second.heights, first.grid)
            c, change = found.coregistration, found.change
            as_it_came = second.heights - first.heights
            _draw(figure, axes[0], as_it_came, colours, limit, f"{title}: difference as it came (m)")
            bias = f"bias {c.bias:+.3f} ± {c.errors[2]:.3f} m taken off"
            east, north = (round(shift, 2) + 0.0 for shift in (c.east, c.north))  # no minus zero
            words = f"{bias}\nshift {east:+.2f} m east, {north:+.2f} m north"
            _draw(figure, axes[1], change.dz, colours, limit / 2, f"change (m), {words}")
            highest = float(np.nanpercentile(change.level, 99))
            _draw(figure, axes[2], change.level, "viridis", highest, "level of detection (m)", lowest=0.0)
            _draw(figure, axes[3], change.dz / change.error, colours, 4.0, "change in standard errors")
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    """A PNG of the colours of both ramps and of greys: a palette of the most frequent colours lacks their ends."""
    ramps = [
        diverging_colours(np.linspace(-1.0, 1.0, _STEPS), 1.0),
        255.0 * colormaps["viridis"](np.linspace(0, 1, _STEPS))[:, :3],
    ]
    greys = np.repeat(np.linspace(0.0, 255.0, 256 - 2 * _STEPS)[:, np.newaxis], 3, axis=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(np.concatenate([*ramps, greys])).astype(np.uint8).ravel().tolist())
    for dpi in _DPI:
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=dpi)
        picture = Image.open(stream).convert("RGB").quantize(palette=palette, dither=Image.Dither.NONE)
        picture.save(path, optimize=True)
        if path.stat().st_size <= BYTES:
            return
    raise ValueError(f"{path} cannot be as small as {BYTES} bytes; draw less of it.")


def _draw(
    figure: Figure,
    axes: Axes,
    values: Float,
    colours: ListedColormap | str,
    limit: float,
    title: str,
    lowest: float | None = None,
) -> None:
    image = axes.imshow(values, cmap=colours, vmin=-limit if lowest is None else lowest, vmax=limit)
    axes.set_title(title)
    axes.set_xticks([])
    axes.set_yticks([])
    figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.8)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[2] / "docs" / "images" / "dem_change.png")

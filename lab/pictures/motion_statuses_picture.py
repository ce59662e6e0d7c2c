"""The picture in docs/displacement.md of where vectors are given, and why there are none elsewhere.

``lab/pictures/motion_statuses_picture.py [FILE]`` makes eight squares of one slope in two surveys, each
with another history, measures them with the default settings, and draws the ground and what the engine says of it.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy import ndimage
from slopewatch.engine.displacement.displacement import Displacement, measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.displacement.status import Status
from slopewatch.engine.maps.displacement_styles import ELLIPSE_ERRORS
from slopewatch.interface.parameters import DisplacementParameters

SIDE, COLUMNS, ROWS = 14.0, 4, 2  # metres of a square in the slope's plane
DIP = np.radians(35.0)
STEP = 0.05  # metres between the nodes of the relief
DENSITY, NOISE = 60.0, 0.02  # returns a m² of the slope, metres
ROUGHNESS, FAINT = 0.08, 0.0085  # metres
SEEN = 0.3  # metres of each two that plants leave free
TIMES = 10.0  # as long as in truth arrows are drawn
WORDS = {
    Status.MEASURED: ("measured; an arrow where the motion is significant", "#cfe3d4"),
    Status.LITTLE_SEEN: ("2  less than 0.3 of the window is seen in both surveys", "#8c8c8c"),
    Status.NO_RELIEF: ("3  no relief that both surveys share", "#f2d98b"),
    Status.RELIEF_ONE_WAY: ("4  relief holds one direction only", "#b9a3d3"),
    Status.NOT_RIGID: ("5  the surfaces do not fit on each other", "#d98f7f"),
    Status.NOT_FOUND: ("6  no motion within the largest that is looked for", "#7fa8d0"),
    Status.UNCERTAIN: ("7  standard error above 0.1 m", "#e3bfa0"),  # in no square of today
}
VECTOR, ONE_WAY = "#b31818", "#c47814"
STYLE = {"axes.titlelocation": "left", "axes.titlesize": 10, "font.size": 8, "legend.fontsize": 8}


@dataclass(frozen=True)
class Square:
    """What a square is, and what happened on it: ``first`` and ``later`` are heights over the plane, metres."""

    words: str
    first: np.ndarray
    later: np.ndarray
    hidden: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))


def relief(roughness: float, seed: int, power: float = 1.5) -> np.ndarray:
    """Heights over the plane with a spectrum of wavenumber^-2 ``power``, metres."""
    count = round(SIDE / STEP)
    rng = np.random.default_rng(seed)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(count), np.fft.rfftfreq(count), indexing="ij"))
    k[0, 0] = np.inf
    heights = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(count, count))) * k**-power, s=(count, count))
    return np.asarray(heights * roughness / heights.std())


def moved(heights: np.ndarray, down: float, aside: float = 0.0) -> np.ndarray:
    """The same relief by so many metres further, rows being down the dip; what leaves a side comes in at the other."""
    return np.asarray(ndimage.shift(heights, (down / STEP, aside / STEP), order=1, mode="grid-wrap"))


def squares() -> list[Square]:
    """Row by row, from the top of the slope."""
    count = round(SIDE / STEP)
    plain, still, other = relief(ROUGHNESS, 1), relief(ROUGHNESS, 2), relief(ROUGHNESS, 3)
    furrows = np.tile(relief(ROUGHNESS, 4)[0], (count, 1))
    smooth, faint = np.zeros((count, count)), relief(FAINT, 6, 1.0)
    rows = np.arange(count) * STEP % 2.0
    under_plants = np.broadcast_to((rows > SEEN)[:, None], (count, count))
    far = relief(ROUGHNESS, 7)
    return [
        Square("A  slid by 0.12 m", plain, moved(plain, 0.12)),
        Square("B  did not move", still, still),
        Square("C  plants hid most of it later", other, other, under_plants),
        Square("D  smooth face", smooth, smooth),
        Square("E  furrows down the dip,\n    moved aside by 0.12 m", furrows, moved(furrows, 0.0, 0.12)),
        Square("F  dug over", other[::-1], other[::-1] + 1.5 * relief(ROUGHNESS, 33)),
        Square("G  slid by 1.15 m, further\n    than is looked for", far, moved(far, 1.15)),
        Square("H  faint relief, slid by 0.12 m", faint, moved(faint, 0.12)),
    ]


def surveyed(made: list[Square], later: bool, seed: int) -> np.ndarray:
    """(n, 3) returns on the squares: east is across the dip, the slope falls to the south."""
    rng = np.random.default_rng(seed)
    shape = np.array([ROWS * SIDE, COLUMNS * SIDE])
    plane = rng.uniform(0.0, 1.0, (int(DENSITY * shape.prod()), 2)) * shape
    across, down = np.floor(plane[:, 1] / SIDE).astype(int), np.floor(plane[:, 0] / SIDE).astype(int)
    inside = plane - SIDE * np.column_stack([down, across])
    node = np.minimum((inside / STEP).astype(int), round(SIDE / STEP) - 1)
    above, seen = np.zeros(len(plane)), np.ones(len(plane), dtype=bool)
    for number, square in enumerate(made):
        here = np.flatnonzero((down == number // COLUMNS) & (across == number % COLUMNS))
        above[here] = (square.later if later else square.first)[tuple(node[here].T)]
        if later and square.hidden.size:
            seen[here] = ~square.hidden[tuple(node[here].T)]
    above += rng.normal(0.0, NOISE, len(plane))
    c, s = np.cos(DIP), np.sin(DIP)
    xyz = np.column_stack([plane[:, 1], s * above - c * plane[:, 0], c * above - s * plane[:, 0]])
    return np.asarray(xyz[seen] + np.array([500_000.0, 3_000_000.0, 100.0]))


def main(path: Path) -> None:
    """Make, measure, draw."""
    made = squares()
    first, later = surveyed(made, False, 11), surveyed(made, True, 12)
    found = measure_displacement(first, later, DisplacementParameters(), Registered.unknown())
    seen = {Status(int(value)) for value in found.vectors.status}
    for number, square in enumerate(made):
        print(square.words, dict(Counter(str(s.name) for s in statuses_within(found, number))))
    with rc_context(STYLE):
        figure = Figure(figsize=(10.4, 7.6), dpi=120, layout="constrained")
        above, below = figure.subplots(2, 1)
        _ground(above, made)
        _answers(below, found)
        named = [WORDS[status] for status in WORDS if status in seen]
        handles = [Patch(facecolor=colour, edgecolor="0.4", label=words) for words, colour in named]
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
        figure.savefig(path)
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


def statuses_within(found: Displacement, number: int, margin: float = 3.0) -> list[Status]:
    """Of the windows whose middles lie well within a square."""
    low = np.array([number % COLUMNS * SIDE, number // COLUMNS * SIDE])
    east, north = found.vectors.places[:, :2].T - np.array([[500_000.0], [3_000_000.0]])
    at = np.column_stack([east, -north / np.cos(DIP)])
    inside = ((at > low + margin) & (at < low + SIDE - margin)).all(axis=1)
    return [Status(int(value)) for value in found.vectors.status[inside]]


def _frame(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlim(0, COLUMNS * SIDE)
    axes.set_ylim(-ROWS * SIDE * np.cos(DIP), 0)
    for number in range(1, COLUMNS):
        axes.axvline(number * SIDE, color="white", lw=1.5)
    axes.axhline(-SIDE * np.cos(DIP), color="white", lw=1.5)
    axes.set(xticks=[], yticks=[])


def _ground(axes: Axes, made: list[Square]) -> None:
    """The later surface, lit from the upper left, with plants over it and what happened to each square."""
    rows = [np.hstack([s.later for s in made[k : k + COLUMNS]]) for k in range(0, len(made), COLUMNS)]
    heights = ndimage.gaussian_filter(np.vstack(rows), 1.0)
    down, aside = np.gradient(heights, STEP)
    plants = np.zeros(heights.shape, dtype=bool)
    for number, square in enumerate(made):
        if square.hidden.size:
            corner = [round(SIDE / STEP) * part for part in divmod(number, COLUMNS)]
            plants[tuple(slice(c, c + n) for c, n in zip(corner, square.hidden.shape, strict=True))] = square.hidden
    shown = np.where(plants, np.nan, down + aside)
    extent = (0, COLUMNS * SIDE, -ROWS * SIDE * np.cos(DIP), 0)
    axes.set_facecolor("#6d7b66")
    axes.imshow(np.clip(shown, -0.6, 0.6), cmap="gray", extent=extent)
    _frame(axes)
    box = {"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2}
    for number, square in enumerate(made):
        x, y = number % COLUMNS * SIDE + 0.4, -(number // COLUMNS) * SIDE * np.cos(DIP) - 0.4
        axes.text(x, y, square.words, va="top", bbox=box)
    axes.set_title("The ground in the later survey, and what happened since the earlier (the slope falls downwards)")


def _answers(axes: Axes, found: Displacement) -> None:
    """The status of each window, arrows with ellipses, and what is known in one direction with its band."""
    grid = found.grid
    west, south, east, north = grid.bounds
    colours = np.ones((grid.rows * grid.columns, 4))
    for status, (_, colour) in WORDS.items():
        here = found.cell[found.vectors.status == status]
        colours[here, :3] = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    extent = (west - 500_000.0, east - 500_000.0, south - 3_000_000.0, north - 3_000_000.0)
    axes.imshow(colours.reshape(grid.rows, grid.columns, 4), extent=extent, interpolation="nearest")
    _frame(axes)
    origin = np.array([500_000.0, 3_000_000.0])
    use = found.significant
    places, step = found.vectors.places[use, :2] - origin, TIMES * found.vectors.motion[use, :2]
    values, axis = np.linalg.eigh(found.vectors.covariance[use][:, :2, :2])
    size = 2 * ELLIPSE_ERRORS * TIMES * np.sqrt(values)
    turn = np.degrees(np.arctan2(axis[:, 1, 1], axis[:, 0, 1]))
    axes.add_collection(
        EllipseCollection(
            size[:, 1], size[:, 0], turn, units="xy", offsets=places + step, offset_transform=axes.transData,
            facecolors=f"{VECTOR}2d", edgecolors=f"{VECTOR}b0", linewidths=0.5, zorder=4,
        )
    )  # fmt: skip
    arrow = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.0016, "zorder": 5}
    axes.quiver(*places.T, *step.T, color=VECTOR, **arrow)
    parts = found.components
    shown = parts.significant(found.confidence)
    at = found.vectors.places[parts.number[shown], :2] - origin
    along = TIMES * parts.direction[shown, :2] * parts.amount[shown, None]
    axes.quiver(*at.T, *along.T, color=ONE_WAY, **arrow)
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    band = np.column_stack([-unit[:, 1], unit[:, 0]])
    for tip, aside in zip(at + along, band, strict=True):
        axes.plot(*np.array([tip - 0.9 * aside, tip + 0.9 * aside]).T, color=ONE_WAY, lw=2.0, alpha=0.6, zorder=4)
    axes.set_title(
        f"What is said of its motion: arrows {TIMES:g} times as long, ellipses of {ELLIPSE_ERRORS:g} standard errors; "
        "orange: that direction only"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/motion_statuses.png"))

"""Displacement vectors in the charts of sections: arrows in the section's plane, longer than in truth."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..core.arrays import Float
from ..maps.map_parts import SMALL
from ..maps.motion_map import VECTOR
from ..maps.picture_words import fonts, say
from ..zones.section_vectors import SectionVectors

_ARROW_SHARE = 0.08  # of a section's length, which the longest arrows take
_LIFT = 0.1  # of the height of the axes, by which arrows stand over the surface, which would hide them


def draw_vectors(
    axes: Axes,
    distance: Float,
    heights: tuple[NDArray[np.floating], NDArray[np.floating]],
    vectors: SectionVectors | None,
) -> None:
    """Arrows just over both surfaces, ``heights`` at ``distance`` (n,), longer than in truth by a round factor.


    They keep their direction against the drawn surface, whatever the exaggeration of heights: what slides along it is
    parallel to it.
    """
    if vectors is None or not len(vectors):
        return
    height = _mean(*heights)
    known = np.isfinite(height)
    if np.count_nonzero(known) < 2:
        return
    times = section_magnification(vectors, axes.get_xlim()[1])
    low, high = axes.get_ylim()
    base = np.interp(vectors.distance, distance[known], height[known]) + _LIFT * (high - low)
    axes.quiver(
        vectors.distance, base, times * vectors.along, times * vectors.up, angles="xy", scale_units="xy", scale=1.0,
        units="inches", width=0.014, headwidth=4.0, headlength=4.5, headaxislength=4.0, minlength=0.5, color=VECTOR,
        zorder=4,
    )  # fmt: skip
    axes.set_ylim(low, high + _LIFT * (high - low))
    axes.text(
        0.0, 1.04, say("arrows: motion, {0} times as long").format(f"{times:g}"), transform=axes.transAxes,
        fontproperties=fonts(SMALL), color=VECTOR, ha="left", va="bottom",
    )  # fmt: skip


def section_magnification(vectors: SectionVectors, length: float) -> float:
    """How many times as long as in truth arrows on a section of ``length`` metres are drawn: 1, 2, 5, 10 and so on."""
    longest = float(np.quantile(np.abs(vectors.along), 0.9))
    wanted = max(_ARROW_SHARE * length / max(longest, 1e-3), 1.0)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step for step in (1.0, 2.0, 5.0) if step == 1.0 or step * power <= wanted) * power


def _mean(first: NDArray[np.floating], later: NDArray[np.floating]) -> Float:
    """Of both heights where both are known, else the known one."""
    both = np.stack([first, later]).astype(np.float64)
    known = np.isfinite(both)
    count = known.sum(axis=0)
    total = np.where(known, both, 0.0).sum(axis=0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))

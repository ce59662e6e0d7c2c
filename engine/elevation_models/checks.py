"""Whether two elevation models show the same ground in the same heights, before their difference is used."""

from __future__ import annotations

import math

import numpy as np

from ..core.arrays import Float
from ..core.errors import InputError
from ..core.messages import shown
from ..epochs.height_systems import compare_heights
from ..statistics.robust import nmad
from .model import ElevationModel

MIN_COMMON_CELLS = 200
_MIN_COARSE_CELLS = 30  # along the longer side, in which heights are compared as a whole
_MAX_SCATTER_RATIO = 0.5  # of the difference to the relief: more is no common ground
_MIN_SCATTER_M = 1.0  # below, a difference may be as large as the relief of level ground


def refuse_other_systems(first: ElevationModel, second: ElevationModel) -> str | None:
    """Refuse two vertical systems; a sentence where not both declare one.

    Raises:
        InputError: they differ.
    """
    if first.vertical and second.vertical:
        if first.vertical != second.vertical:
            raise InputError(
                f"{shown(first.path)} has heights in {first.vertical}, and {shown(second.path)} in {second.vertical}; "
                "bring both to one vertical system."
            )
        return None
    if first.vertical or second.vertical:
        with_one, without = (first, second) if first.vertical else (second, first)
        return (
            f"{shown(without.path)} declares no vertical system; its heights are taken as those of "
            f"{shown(with_one.path)}, {with_one.vertical}."
        )
    return None


def refuse_other_ground(first: ElevationModel, second: ElevationModel, maximum_bias: float) -> None:
    """Refuse models on one grid that do not show the same ground in the same unit and system.

    Args:
        maximum_bias: even offsets up to this (metres) are taken off.

    Raises:
        InputError: too few common cells, equal heights, feet beside metres, an even offset, or no common relief.
    """
    names = shown(first.path), shown(second.path)
    dz = second.heights - first.heights
    common = np.isfinite(dz)
    number = int(common.sum())
    if number < MIN_COMMON_CELLS:
        raise InputError(
            f"{names[0]} and {names[1]} have {number} cells with heights of both, fewer than {MIN_COMMON_CELLS}; give "
            "models of the same place."
        )
    values = dz[common]
    if not values.any():
        raise InputError(
            f"{names[0]} and {names[1]} have the same height in all {number:,} common cells; give two dates."
        )
    rounding = float(np.spacing(np.float32(np.nanmax(np.abs(second.heights)))))
    if float(np.ptp(values)) <= 2.0 * rounding:  # two steps of 32-bit numbers: of either model one half, twice
        raise InputError(
            f"{names[0]} and {names[1]} differ by the same {float(np.median(values)):.3f} m in all {number:,} common "
            "cells, so one was made from the other; give two surveys."
        )
    found = compare_heights(*(_coarse(model.heights).ravel() for model in (first, second)))
    if found is not None and found.unit_ratio is not None:
        raise InputError(
            f"The heights of {names[1]} are {found.unit_ratio:.3f} times those of {names[0]}, so one of them is in "
            "feet; give its unit with --height-unit, or convert it."
        )
    offset, scatter = float(np.median(values)), nmad(values)
    relief = min(nmad(model.heights[common]) for model in (first, second))
    if scatter > max(_MAX_SCATTER_RATIO * relief, _MIN_SCATTER_M):
        raise InputError(
            f"{names[0]} and {names[1]} differ by {scatter:.2f} m (NMAD) where the relief is {relief:.2f} m: they show "
            "other ground, or one is no elevation model (a hillshade, a slope); check both."
        )
    if abs(offset) > maximum_bias:
        higher, lower = names if offset < 0 else names[::-1]
        raise InputError(
            f"{higher} lies {abs(offset):.2f} m above {lower} at the median, more than the maximum_bias of "
            f"{maximum_bias:g} m: another vertical system rather than a campaign's bias; bring both to one."
        )


def _coarse(heights: Float) -> Float:
    step = max(1, math.ceil(max(heights.shape) / _MIN_COARSE_CELLS))
    return heights[::step, ::step]

"""The course of one zone of a series: mean change and motion against the first survey, with 95 % bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

import numpy as np
from matplotlib.dates import date2num

from ...maps.map_parts import Sheet
from ...maps.picture_words import date_axis, fonts
from ...statistics.normal import Z95
from ..charts import finish
from .sections import as_svg

_WIDTH_IN, _LEFT_IN, _RIGHT_IN = 6.93, 0.62, 0.09
_BELOW_IN = 0.38
_COLOUR = "#1f77b4"
_CURVES = (
    ("dz_mean_m", "dz_err_m", "mean change (m)"),
    ("motion_m", "motion_err_m", "motion along the surface (m)"),
)


def has_motion(course: Sequence[Mapping[str, Any]]) -> bool:
    """Whether motion along the surface is known of a survey."""
    return any("motion_m" in row and "motion_err_m" in row for row in course)


def course_drawing(course: Sequence[Mapping[str, Any]], first: str, height_mm: float) -> bytes:
    """A chart as SVG: the mean change, and next to it motion along the surface where it is known.

    Args:
        course: the surveys from the second on, as in the run record; what a survey did not measure is left out.
        first: day of the first survey.
    """
    height = height_mm / 25.4
    sheet = Sheet(_WIDTH_IN, height)
    curves = _CURVES if has_motion(course) else _CURVES[:-1]
    step = (_WIDTH_IN - _RIGHT_IN) / len(curves)
    for number, (value, error, words) in enumerate(curves):
        axes = sheet.axes(_LEFT_IN + number * step, _BELOW_IN, step - _LEFT_IN - 0.1, height - _BELOW_IN - 0.08)
        known = [row for row in course if value in row and error in row]
        # dates as numbers: matplotlib's own conversion takes lists of dates, which type checkers do not know
        days = np.asarray(date2num([date.fromisoformat(d) for d in (first, *(str(row["epoch"]) for row in known))]))
        middle = np.array([0.0, *(row[value] for row in known)])
        half = Z95 * np.array([0.0, *(row[error] for row in known)])
        axes.fill_between(days, middle - half, middle + half, color=_COLOUR, alpha=0.2, lw=0)
        axes.plot(days, middle, color=_COLOUR, lw=1.2, marker="o", ms=3)
        axes.axhline(0.0, color="#57606a", lw=0.6)
        date_axis(axes.xaxis, max_ticks=8 if len(curves) < len(_CURVES) else 5)
        finish(axes, "", words)
        axes.xaxis.get_offset_text().set_fontproperties(fonts(7.5))
    return as_svg(sheet)

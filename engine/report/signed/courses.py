"""The course of one zone of a series: mean change and net volume against the first survey, with 95 % bands."""

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

_WIDTH_IN, _LEFT_IN, _AXES_IN, _STEP_IN = 6.93, 0.62, 2.72, 3.5
_BELOW_IN = 0.38
_COLOUR = "#1f77b4"


def course_drawing(course: Sequence[Mapping[str, Any]], first: str, height_mm: float) -> bytes:
    """A chart as SVG: the change on the left, the volume on the right.

    Args:
        course: the surveys from the second on, as in the run record; what a survey did not measure is left out.
        first: day of the first survey.
    """
    height = height_mm / 25.4
    sheet = Sheet(_WIDTH_IN, height)
    for number, (value, error, words) in enumerate(
        (("dz_mean_m", "dz_err_m", "mean change (m)"), ("vol_net_m3", "vol_err_m3", "net volume (m³)"))
    ):
        axes = sheet.axes(_LEFT_IN + number * _STEP_IN, _BELOW_IN, _AXES_IN, height - _BELOW_IN - 0.08)
        known = [row for row in course if value in row and error in row]
        # dates as numbers: matplotlib's own conversion takes lists of dates, which type checkers do not know
        days = np.asarray(date2num([date.fromisoformat(d) for d in (first, *(str(row["epoch"]) for row in known))]))
        middle = np.array([0.0, *(row[value] for row in known)])
        half = Z95 * np.array([0.0, *(row[error] for row in known)])
        axes.fill_between(days, middle - half, middle + half, color=_COLOUR, alpha=0.2, lw=0)
        axes.plot(days, middle, color=_COLOUR, lw=1.2, marker="o", ms=3)
        axes.axhline(0.0, color="#57606a", lw=0.6)
        date_axis(axes.xaxis, max_ticks=5)
        finish(axes, "", words)
        axes.xaxis.get_offset_text().set_fontproperties(fonts(7.5))
    return as_svg(sheet)

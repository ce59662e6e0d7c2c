"""Charts of the report: distributions of the change, profiles, and the course of a series' zones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import date2num

from ..core.arrays import Float
from ..core.number_text import fixed
from ..maps.map_parts import INK, SMALL, Sheet
from ..maps.palette import BELOW_LEVEL, DIVERGING, hexadecimal
from ..maps.picture_words import date_axis, fonts, say
from ..statistics.normal import Z95
from ..zones.section_vectors import SectionVectors
from .embedding import Picture, drawing
from .vector_arrows import draw_vectors

_LOWERED, _RAISED = hexadecimal(DIVERGING[4][1]), hexadecimal(DIVERGING[4][2])
_GREY = hexadecimal(BELOW_LEVEL)
_BEFORE = "#8a8f98"
_SOFT = "#57606a"
_WIDTH, _WIDE = 4.2, 7.2  # inches
_LONGEST_STEP = 2.6
"""Of cells that touch, over the usual one: on a line at 35 degrees they are 0.57, 0.82 and 1.39 cells long."""
COURSES = 8
"""Zones whose course is drawn; more cannot be distinguished."""


def change_histogram(record: Mapping[str, Any]) -> Picture:
    """All cells and, below, those beyond their level, as areas; both with the median level drawn."""
    shown, area = record["distribution"], record["grid"]["cell_m"] ** 2
    level = record["level"]["median_m"]
    sheet = Sheet(_WIDTH, 3.6)
    above, below = sheet.axes(0.65, 2.1, 3.4, 1.35), sheet.axes(0.65, 0.5, 3.4, 1.35)
    edges, _ = _bins(shown)
    compared, beyond = (np.array(shown[name]) * area for name in ("compared", "beyond"))
    half = len(beyond) // 2
    # one shape each: a bar a bin takes ten times as long to draw
    above.stairs(compared, edges, fill=True, color=_GREY)
    below.stairs(beyond[:half], edges[: half + 1], fill=True, color=_LOWERED)
    below.stairs(beyond[half:], edges[half:], fill=True, color=_RAISED)
    low, high = record["level"]["p05_m"], record["level"]["p95_m"]
    for axes, words, below_it in ((above, "all cells", ""), (below, "beyond their level", "elevation change (m)")):
        for sign in (-1, 1):
            axes.axvspan(sign * low, sign * high, color="#000000", alpha=0.06, lw=0)
            axes.axvline(sign * level, color=INK, lw=1.0, ls=(0, (4, 3)))
        finish(axes, below_it, "area (m²)")
        axes.set_xlim(-shown["reach_m"], shown["reach_m"])
        axes.text(0.015, 0.9, say(words), transform=axes.transAxes, fontproperties=fonts(8, "bold"), color=INK)
    above.set_xticklabels([])
    return drawing(
        sheet.figure,
        "Histograms of the elevation change: all cells above, cells beyond their level of detection below, with the "
        f"median level of {level:.3f} m drawn on both sides of zero",
    )


def stable_histogram(record: Mapping[str, Any]) -> Picture | None:
    """Change on stable ground compared with the normal distribution of its median and NMAD; None without such
    ground.
    """
    facts, shown = record["stable_ground"], record["distribution"]
    if facts is None:
        return None
    sheet = Sheet(_WIDTH, 3.6)
    axes = sheet.axes(0.65, 0.5, 3.4, 2.95)
    edges, width = _bins(shown)
    axes.stairs(shown["stable"], edges, fill=True, color="#9fb3a5")
    spread = facts["nmad_m"]
    reach = shown["reach_m"]
    if spread > 0:
        reach = min(reach, max(5.0 * spread + abs(facts["median_m"]), 3.0 * width))
        x = np.linspace(-reach, reach, 400)
        density = np.exp(-0.5 * ((x - facts["median_m"]) / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
        axes.plot(x, density * facts["cells"] * width, color=INK, lw=1.2)
    for sign in (-1, 1):
        axes.axvline(sign * record["level"]["median_m"], color=INK, lw=1.0, ls=(0, (4, 3)))
    finish(axes, "elevation change on stable ground (m)", "number of cells")
    axes.set_xlim(-reach, reach)
    return drawing(
        sheet.figure,
        f"Histogram of the elevation change on stable ground: median {fixed(facts['median_m'], 4, sign=True)} m, "
        f"spread (NMAD) {spread:.3f} m, with the normal distribution of these figures",
    )


def profile_chart(
    facts: Mapping[str, Any],
    columns: Mapping[str, Float] | None,
    epochs: tuple[str, str],
    vectors: SectionVectors | None = None,
) -> Picture:
    """Heights of both epochs along a line, and below their difference with the level of detection as a ribbon.

    Args:
        vectors: motion along the surface near the line.
    """
    sheet = Sheet(_WIDE, 2.15)
    above, below = sheet.axes(0.6, 1.2, 6.5, 0.78), sheet.axes(0.6, 0.4, 6.5, 0.7)
    length = facts["length_m"]
    if columns is not None and np.isfinite(columns["dz_m"]).any():
        draw_heights(above, columns, epochs)
        draw_difference(below, columns)
    else:
        above.text(0.5, 0.5, say("not measured"), transform=above.transAxes, ha="center", fontproperties=fonts(9))
    for axes, *words in ((above, "", "height (m)"), (below, "distance along the line (m)", "change (m)")):
        axes.set_xlim(0, length)
        finish(axes, *words)
    if columns is not None:
        draw_vectors(above, columns["distance_m"], (columns["height_from_m"], columns["height_to_m"]), vectors)
    above.set_xticklabels([])
    sheet.figure.align_ylabels([above, below])
    lowest, highest = facts["dz_min_m"], facts["dz_max_m"]
    range_in_words = (
        "no ground that both surveys measured"
        if lowest is None
        else f"change from {fixed(lowest, 3, sign=True)} to {fixed(highest, 3, sign=True)} m"
    )
    return drawing(
        sheet.figure,
        f"Profile of {length:.1f} m: heights of both surveys, and their difference with the level of detection; "
        f"{range_in_words}{_vectors_in_words(vectors)}",
    )


def _vectors_in_words(vectors: SectionVectors | None) -> str:
    if vectors is None or not len(vectors):
        return ""
    along = fixed(float(np.median(vectors.along)), 3, sign=True)
    return f"; {len(vectors)} displacement vectors near the line, by {along} m along it in the median"


def course_chart(record: Mapping[str, Any]) -> Picture | None:
    """Mean change of the first ``COURSES`` zones against the day, with 95 % bands; None without zones.

    The volume is the mean change times the area, so it has the same course. A survey that did not measure a
    zone is left out of its curve.
    """
    course = record.get("course")
    if not course:
        return None
    names = [zone["zone_id"] for zone in record["zones"][:COURSES]]
    days = [date.fromisoformat(day) for day in record["dates"]]
    sheet = Sheet(_WIDE, 2.9)
    axes = sheet.axes(0.7, 0.45, 6.3, 2.0)
    for number, name in enumerate(names):
        known = [row for row in course[name] if "dz_mean_m" in row and "dz_err_m" in row]
        at = [days[0], *(date.fromisoformat(row["epoch"]) for row in known)]
        middle = np.array([0.0, *(row["dz_mean_m"] for row in known)])
        half = Z95 * np.array([0.0, *(row["dz_err_m"] for row in known)])
        # dates as numbers: matplotlib's own conversion takes lists of dates, which type checkers do not know
        x, colour = np.asarray(date2num(at)), f"C{number}"
        axes.fill_between(x, middle - half, middle + half, color=colour, alpha=0.2, lw=0)
        axes.plot(x, middle, color=colour, lw=1.1, marker="o", ms=3, label=name.replace("$", r"\$"))
    _finish_course(axes, days, "mean change (m)", len(names))
    ends = "; ".join(
        f"{name} changed by {fixed(row['dz_mean_m'], 3, sign=True)} m"
        for name in names
        for row in [r for r in course[name] if "dz_mean_m" in r][-1:]
    )
    return drawing(
        sheet.figure,
        f"Mean change of {len(names)} zones against the first survey on {len(days)} days, with 95 % bands; at the "
        f"end: {ends}",
    )


def _finish_course(axes: Axes, days: Sequence[date], words: str, curves: int) -> None:
    """Zero, the surveys' days, and the names of the curves above them."""
    axes.axhline(0.0, color=_SOFT, lw=0.6)
    for day in date2num(days):
        axes.axvline(day, color="#6e7781", lw=0.6, ls=(0, (2, 3)), zorder=0.5)
    first, last = date2num([days[0], days[-1]])
    axes.set_xlim(first - 0.02 * (last - first), last + 0.02 * (last - first))
    date_axis(axes.xaxis, max_ticks=8)
    finish(axes, "", words)
    axes.xaxis.get_offset_text().set_fontproperties(fonts(SMALL))
    axes.legend(
        loc="lower left", frameon=False, ncols=curves, prop=fonts(SMALL), borderaxespad=0.0, handlelength=1.2,
        columnspacing=1.2, bbox_to_anchor=(0.0, 1.02),
    )  # fmt: skip


def motion_chart(record: Mapping[str, Any]) -> Picture | None:
    """Motion along the surface of the first ``COURSES`` zones that have any, with 95 % bars, and the lines of their
    velocities; None without.
    """
    course = record.get("course") or {}
    zones = [z for z in record["zones"] or () if any("motion_m" in row for row in course.get(z["zone_id"], ()))]
    if not zones:
        return None
    days = [date.fromisoformat(day) for day in record["dates"]]
    numbers = [zone["zone_id"] for zone in record["zones"]]  # the colours of the other charts
    sheet = Sheet(_WIDE, 2.75)
    axes = sheet.axes(0.7, 0.45, 6.3, 1.9)
    drawn = zones[:COURSES]
    for zone in drawn:
        known = [row for row in course[zone["zone_id"]] if "motion_m" in row and "motion_err_m" in row]
        x = np.asarray(date2num([days[0], *(date.fromisoformat(row["epoch"]) for row in known)]))
        middle = np.array([0.0, *(row["motion_m"] for row in known)])
        half = Z95 * np.array([0.0, *(row["motion_err_m"] for row in known)])
        axes.errorbar(
            x, middle, yerr=half, color=f"C{numbers.index(zone['zone_id']) % 10}", lw=1.1, marker="o", ms=3.5,
            capsize=2.5, elinewidth=0.9, label=zone["zone_id"].replace("$", r"\$"),
        )  # fmt: skip
    _finish_course(axes, days, "motion along the surface (m)", len(drawn))
    ends = "; ".join(
        f"{zone['zone_id']} moved by {fixed(row['motion_m'], 3, sign=True)} m"
        for zone in drawn
        for row in [r for r in course[zone["zone_id"]] if "motion_m" in r][-1:]
    )
    return drawing(
        sheet.figure,
        f"Motion along the surface of {len(drawn)} zones against the first survey on {len(days)} days, with 95 % bars; "
        f"at the end: {ends}",
    )


def draw_heights(axes: Axes, columns: Mapping[str, Float], epochs: tuple[str, str]) -> None:
    """Heights of both surveys along a line, by the columns of a table of profiles."""
    distance = columns["distance_m"]
    for name, colour, width, label in (
        ("height_from_m", _BEFORE, 1.5, epochs[0]),
        ("height_to_m", INK, 0.7, epochs[1]),
    ):
        axes.plot(
            distance, columns[name], color=colour, lw=width, label=label.replace("$", r"\$"), solid_capstyle="butt"
        )
    axes.legend(
        loc="upper right", frameon=False, ncols=2, prop=fonts(SMALL), borderaxespad=0.1, handlelength=1.6,
        bbox_to_anchor=(1.0, 1.22),
    )  # fmt: skip


def draw_difference(axes: Axes, columns: Mapping[str, Float]) -> None:
    """The change along a line with its level of detection as a ribbon, by the columns of a table of profiles."""
    distance, dz, level = columns["distance_m"], columns["dz_m"], columns["level_m"]
    edges, heights = _ribbon(distance, level)
    axes.fill_between(edges, -heights, heights, color=_GREY, alpha=0.4, lw=0)
    axes.axhline(0.0, color=_SOFT, lw=0.6)
    axes.plot(distance, dz, color="#6e7781", lw=0.5, marker=".", ms=2.0, mew=0)
    beyond = columns["significant"] > 0
    for chosen, colour in ((beyond & (dz < 0), _LOWERED), (beyond & (dz > 0), _RAISED)):
        axes.plot(distance[chosen], dz[chosen], ".", color=colour, ms=3.6, mew=0)
    # the ribbon shall not shrink what lies beyond it, nor a single wide level the whole chart
    reach = max(1.15 * np.nanmax(np.abs(dz)), 1.3 * np.nanmedian(level))
    axes.set_ylim(-reach, reach)


def _ribbon(distance: Float, level: Float) -> tuple[Float, Float]:
    """A band that has each cell's level over the cell's own width; NaN between cells that do not touch.

    A line across the cells meets them in steps of very different length, so that two of them touch where no cell
    without a level lies between, and the step is none over cells that are not listed.
    """
    known = np.flatnonzero(np.isfinite(level))
    distance, level = distance[known], level[known]
    steps = np.diff(distance)
    usual = float(np.median(steps)) if steps.size else 0.625
    half = np.full(len(distance), usual / 2.0)
    left, right = distance - half, distance + half
    near = (np.diff(known) == 1) & (steps <= _LONGEST_STEP * usual)
    middles = (distance[1:] + distance[:-1]) / 2
    right[:-1][near], left[1:][near] = middles[near], middles[near]
    edges = np.column_stack([left, right, np.full(len(left), np.nan)])
    heights = np.column_stack([level, level, np.full(len(level), np.nan)])
    joined = np.append(near, False)
    edges[joined, 2], heights[joined, 2] = right[joined], level[joined]
    return edges.ravel(), heights.ravel()


def _bins(shown: Mapping[str, Any]) -> tuple[Float, float]:
    """Edges and width of the distribution's bins."""
    width = shown["bin_m"]
    count = len(shown["compared"])
    return (np.arange(count + 1) - count / 2) * width, width


def finish(axes: Axes, below: str, left: str) -> None:
    """Frame, grid, tick labels and the words ``below`` and ``left`` of the axes, as all charts have them."""
    axes.locator_params(axis="y", nbins=5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set(color="#8c959f", linewidth=0.6)
    axes.tick_params(colors=_SOFT, length=3, width=0.6)
    axes.grid(axis="y", color="#eaeef2", lw=0.6)
    axes.set_axisbelow(True)
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_fontproperties(fonts(SMALL))
    axes.set_xlabel(say(below), fontproperties=fonts(8), color=INK)
    axes.set_ylabel(say(left), fontproperties=fonts(8), color=INK)

"""The slopes in the order in which they should be looked at."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import geopandas as gpd
import numpy as np
import pandas as pd

from ...engine.vector.review_fields import is_entered
from ...engine.zones.fields import SLIDING
from .alert_events import open_of
from .jobs import Problem
from .results import SlopeResult


@dataclass(frozen=True)
class Ranked:
    """A slope as the page shows it. ``rate_mm_day`` and ``volume_m3`` are the largest of a zone, by size; None: none.

    ``report`` is its report's path from the page, empty where there is none; ``sentence`` says why it failed.
    """

    slope: str
    surveys: int
    last_day: str
    command: str
    zones: int
    attention: int
    open_alerts: int
    rate_mm_day: float | None
    volume_m3: float | None
    largest_m: float | None
    chainage: float | None
    report: str
    sentence: str = ""
    location: str = ""


def rank(
    results: Sequence[SlopeResult], zones: gpd.GeoDataFrame, alerts: gpd.GeoDataFrame, folder: Path
) -> list[Ranked]:
    """Slopes that are done: by highest attention, number of open alerts, fastest zone, largest volume, and name.

    Args:
        folder: where the page will lie.
    """
    count = open_of(alerts).groupby("slope").size()
    found = []
    for result in results:
        own = zones[zones["slope"] == result.slope]
        report = result.outputs.get("report")
        found.append(
            Ranked(
                slope=result.slope,
                surveys=len(result.days),
                last_day=result.days[-1],
                command=result.command,
                zones=int((own["source"] != "screening").sum()) or len(own),
                attention=int(own["attention"].fillna(0).max()) if len(own) else 0,
                open_alerts=int(count.get(result.slope, 0)),
                rate_mm_day=_largest(own["rate_mm_day"]),
                volume_m3=_largest(own["vol_net_m3"]),
                largest_m=_largest(_sizes(own)),
                chainage=None if own["chain_from"].isna().all() else float(own["chain_from"].min()),
                location=_first_location(own),
                report="" if report is None else Path(os.path.relpath(report, folder)).as_posix(),
            )
        )
    return sorted(found, key=_order)


def _order(slope: Ranked) -> tuple[float | str, ...]:
    return (
        -slope.attention,
        -slope.open_alerts,
        -abs(slope.rate_mm_day or 0.0),
        -abs(slope.volume_m3 or 0.0),
        -(slope.largest_m or 0.0),
        slope.slope,
    )


def _sizes(zones: gpd.GeoDataFrame) -> pd.Series:
    """How far the ground of each zone moved: along the surface where it slid, else by its heights, metres."""
    if "motion_m" not in zones:
        return zones["dz_p95_m"]
    return zones["dz_p95_m"].where(zones["kind"] != SLIDING, zones["motion_m"])


def _largest(values: object) -> float | None:
    """The value that is largest by size; None where none is known."""
    numbers = np.asarray(values, dtype=np.float64)
    numbers = numbers[np.isfinite(numbers)]
    return float(numbers[np.argmax(np.abs(numbers))]) if len(numbers) else None


def failed(problems: Sequence[Problem], states: Mapping[str, str]) -> list[tuple[str, str]]:
    """Slope and sentence of each problem, and of each slope (``states`` by name) that failed at work, by name."""
    rows = [(problem.slope or "(no slope named)", problem.sentence) for problem in problems]
    return sorted(rows + list(states.items()))


def _first_location(zones: gpd.GeoDataFrame) -> str:
    """Of the zone that comes first along the road; empty where none has its place there."""
    placed = zones[zones["location"].map(lambda text: is_entered("location", text))]
    return "" if placed.empty else str(placed.sort_values("chain_from")["location"].iloc[0])

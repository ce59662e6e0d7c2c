"""The words on a map."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Words:
    """What a map says of itself; an elevation change by default.

    ``low`` and ``high`` name the legend's ends, ``veil`` and ``outline`` the keys; ``notes`` stand below the title,
    those of a change where they are empty. ``signed``: whether the legend's numbers have a sign.
    """

    title: str = "Elevation change"
    legend: str = "Elevation change (m)"
    low: str = "lowered"
    high: str = "raised"
    veil: tuple[str, str] = ("grey veil: measured, but", "below the level of detection")
    outline: str = "hazard zone"
    notes: str = ""
    signed: bool = True

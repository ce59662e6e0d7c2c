"""Parameters of hazard zones."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class ZoneParameters(ParameterSet, record_name="zones"):
    """Hazard zones: contiguous cells of significant change."""

    minimum_area: float = _parameter(
        0.5,
        "Minimum area of a zone",
        "Smaller groups of significant cells are not reported; small gaps without data within a group count. Larger "
        "reports fewer and more reliable zones.",
        unit="m²",
        bounds=(0.0, 1e6),
    )
    minimum_cells: int = _parameter(
        5,
        "Minimum cells in a zone",
        "Smaller groups of significant cells are not reported, whatever their area. A part of a grown cell counts as a "
        "part, a grown cell far beyond its level as up to half of this number. Larger is more reliable where cells are "
        "large: on 90 unchanged simulated slopes with cells that grow, groups of five or more occurred by chance on "
        "one.",
        bounds=(2, 100000),
        advanced=True,
    )
    minimum_confidence: float = _parameter(
        0.95,
        "Minimum confidence of a zone",
        "Groups of significant cells that noise alone may produce somewhere on the map are not reported. 0.95: one "
        "unchanged map in twenty would have one. Larger is more reliable and misses more. With less than 0.95, zones "
        "below that have the severity unsure; 0 reports all.",
        bounds=(0.0, 0.9999),
        advanced=True,
    )
    bridged_gap: float = _parameter(
        0.2,
        "Gap without data that does not divide a zone",
        "Parts this close with nothing measured between them, as under vegetation, are one zone; the gap does not "
        "count in its area. A volume includes what lies this close to measured cells. Larger joins more. 0: only "
        "cells that touch.",
        unit="m",
        bounds=(0.0, 100.0),
        advanced=True,
    )
    severity_moderate: float = _parameter(
        0.10,
        "Moderate from",
        "A zone whose change (95th percentile) reaches this is moderate, else low.",
        unit="m",
        bounds=(0.0, 100.0),
        advanced=True,
    )
    severity_high: float = _parameter(
        0.30,
        "High from",
        "A zone whose change (95th percentile) reaches this is high.",
        unit="m",
        bounds=(0.0, 100.0),
        advanced=True,
    )

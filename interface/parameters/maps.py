"""Parameters of the heatmap."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class HeatmapParameters(ParameterSet, record_name="heatmap"):
    """Heatmap over the top view."""

    top_view_pixel: float = _parameter(
        0.1,
        "Pixel of the top view",
        "Side of a pixel of the orthographic top view. Smaller is sharper where the cloud is dense enough.",
        unit="m",
        bounds=(0.005, 100.0),
    )
    opacity: float = _parameter(
        0.6,
        "Opacity of the heatmap",
        "0 shows the top view alone, 1 the change alone.",
        bounds=(0.0, 1.0),
    )
    colour_range: float | str = _parameter(
        AUTO,
        "Colour range",
        "The legend runs from minus to plus this change. auto: from the data (98th percentile).",
        kind=float,
        unit="m",
        bounds=(0.001, 1000.0),
    )

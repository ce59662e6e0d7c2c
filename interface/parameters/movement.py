"""Parameters of what zones did."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class MovementParameters(ParameterSet, record_name="movement", title="What zones did"):
    """Whether the ground of a zone sank, bulged, slid along the surface, or lost or gained material."""

    movement: bool = _parameter(
        False,
        "Say what each zone did",
        "Heights, distances along the normal and motion along the surface together say of each zone whether it sank, "
        "bulged, slid, or lost or gained material; ground that slid becomes one zone of the kind sliding, with its "
        "head and its toe. Takes as long as the displacement vectors do.",
    )
    movement_confidence: float = _parameter(
        0.99,
        "Confidence of what a zone did",
        "Probability that ground which only sank or bulged is not said to have slid, and that ground at rest is not "
        "said to have sunk. Larger leaves more zones undecided.",
        bounds=(0.5, 0.9999),
        advanced=True,
    )

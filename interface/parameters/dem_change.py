"""Parameters of the change between elevation models."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import AUTO, ParameterSet, _parameter


@dataclass(frozen=True)
class ModelParameters(ParameterSet, record_name="elevation_models", title="Elevation models"):
    """How elevation models of several dates are compared."""

    cell: float | str = _parameter(
        AUTO,
        "Cell size",
        "Side of a grid cell, not smaller than those of the coarsest model. Larger is less noisy, and hides smaller "
        "change. auto: that of the coarsest model.",
        kind=float,
        unit="m",
        bounds=(0.01, 1000.0),
    )
    confidence: float = _parameter(
        0.95,
        "Confidence of the level of detection",
        "Probability that unchanged ground stays below the level. Larger reports less change, and more reliably.",
        bounds=(0.5, 0.9999),
    )
    plan_shift: bool = _parameter(
        True,
        "Take off a shift in plan",
        "Looks for a horizontal shift of each model, and takes it off where the relief shows it beyond its own error. "
        "Off: only the bias in height is taken off.",
    )
    tilt: bool = _parameter(
        False,
        "Take off a tilt or bend",
        "Takes off the tilt or bend between the models, if stable ground shows one beyond its own error. Off: it is "
        "named, and stays in the change. Movement of that shape over the whole map is taken off with it.",
    )
    statistics_only: bool = _parameter(
        False,
        "Statistics only",
        "Writes the run record and the table of pairs, and no rasters, zones, pictures or report.",
    )
    maximum_bias: float = _parameter(
        5.0,
        "Largest bias",
        "Models that differ by more at the median are refused, as of different vertical systems. Larger takes off "
        "larger offsets.",
        unit="m",
        bounds=(0.0, 200.0),
        advanced=True,
    )

"""What a coregistration found, in words and for the run record."""

from __future__ import annotations

import math
from typing import Any

from .comparison import ModelChange

_MIN_DEVIATIONS = 2.576  # beyond so many of its standard errors a bias is named as one
MIN_STABLE_SHARE = 0.5
"""Share of the compared cells that must be found stable, because bias and errors are judged by what most of them do."""


def bias_sentence(found: ModelChange, first: str, second: str) -> str:
    """Whether the later model is biased, and by how much."""
    bias, error = found.coregistration.bias, found.coregistration.errors[2]
    if abs(bias) <= _MIN_DEVIATIONS * error:
        return (
            f"{second} lies {bias:+.3f} m from {first} on stable ground, which its standard error of {error:.3f} m "
            "explains; it was taken off."
        )
    if bias > 0:
        return (
            f"{second} lies {bias:.3f} m above {first} on stable ground (standard error {error:.3f} m): a bias of the "
            "campaign or of its vertical datum, which was taken off and is no change."
        )
    return (
        f"{second} lies {-bias:.3f} m below {first} on stable ground (standard error {error:.3f} m): a bias of the "
        "campaign or of its vertical datum, which was taken off and is no change."
    )


def shift_sentence(found: ModelChange, first: str, second: str) -> str:
    """Whether the later model is shifted in plan, and by how much."""
    coregistration = found.coregistration
    if coregistration.found is None:
        return f"No shift in plan of {second} was looked for or could be: {coregistration.why}."
    east, north, east_error, north_error = coregistration.found
    measured = f"east {east:+.3f} m (standard error {east_error:.3f} m), north {north:+.3f} m ({north_error:.3f} m)"
    if coregistration.why:
        return f"No shift in plan of {second} was taken off, because {coregistration.why}: {measured}."
    return f"{second} was shifted in plan against {first}, {measured}; that was taken off."


def coregistration_facts(found: ModelChange, first: str, second: str) -> dict[str, Any]:
    """For the run record; lengths in metres."""
    c = found.coregistration
    measured = c.found or (None, None, None, None)
    stable = int(found.change.stable.sum())
    return {
        "from": first,
        "to": second,
        "bias_m": c.bias,
        "bias_error_m": c.errors[2],
        "shift_east_m": c.east,
        "shift_north_m": c.north,
        "measured_east_m": measured[0],
        "measured_north_m": measured[1],
        "measured_east_error_m": measured[2],
        "measured_north_error_m": measured[3],
        "plan_shift": "taken off" if not c.why else c.why,
        "error_m": found.change.registration_error,
        "nmad_before_m": c.nmad_before,
        "nmad_after_m": c.nmad_after,
        "stable_cells": stable,
        "stable_share": stable / max(int(found.change.valid.sum()), 1),
        "stable_given": found.stable_given,
        "errors_by": list(found.errors.names),
        "attributes": found.attributes,
        "sentences": [bias_sentence(found, first, second), shift_sentence(found, first, second)],
    }


def stable_doubt(found: ModelChange, first: str, second: str) -> str | None:
    """A warning where too little ground was found stable for bias and errors to be known."""
    share = found.change.stable.sum() / max(int(found.change.valid.sum()), 1)
    if found.stable_given or share >= MIN_STABLE_SHARE or math.isnan(share):
        return None
    return (
        f"Only {100 * share:.0f} % of the ground looks stable from {first} to {second}; the bias and the errors are "
        "taken from it and may be wrong; give an area known to be stable."
    )

"""What a coregistration found, in words and for the run record."""

from __future__ import annotations

import math
from typing import Any

from .comparison import ModelChange
from .trend import BEND

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


def trend_sentence(found: ModelChange, first: str, second: str) -> str:
    """Whether the models differ by a tilt or bend, by how much, and what became of it."""
    trend = found.trend
    if trend.why:
        return f"A tilt or bend of {second} could not be looked for: {trend.why}."
    if not trend.order:
        return f"Stable ground shows no tilt or bend between {first} and {second} beyond their errors."
    if found.trend_taken_off:
        return f"{_trend(found, first, second)}; that was taken off and is no change."
    return f"{_trend(found, first, second)}; that was not taken off."


def _trend(found: ModelChange, first: str, second: str) -> str:
    tilt, tilt_error = found.trend.tilt
    if found.trend.order < BEND:
        return f"{first} and {second} differ by a tilt of {tilt:.3f} m over the map (standard error {tilt_error:.3f} m)"
    bend, bend_error = found.trend.bend
    return (
        f"{first} and {second} differ by a bend of {bend:.3f} m (standard error {bend_error:.3f} m) and a tilt of "
        f"{tilt:.3f} m ({tilt_error:.3f} m) over the map"
    )


def trend_warning(found: ModelChange, first: str, second: str) -> str | None:
    """What to do about a tilt or bend that was not taken off."""
    if not found.trend.order or found.trend_taken_off:
        return None
    return (
        f"{_trend(found, first, second)}, which widens the level of detection and may hide change. Switch on 'Take off "
        "a tilt or bend', unless the ground itself may have moved like that."
    )


def coregistration_facts(found: ModelChange, first: str, second: str) -> dict[str, Any]:
    """For the run record; lengths in metres."""
    c = found.coregistration
    measured = c.found or (None, None, None, None)
    sentences = [sentence(found, first, second) for sentence in (bias_sentence, shift_sentence, trend_sentence)]
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
        **trend_facts(found),
        "error_m": found.change.registration_error,
        "nmad_before_m": c.nmad_before,
        "nmad_after_m": c.nmad_after,
        "stable_cells": stable,
        "stable_share": stable / max(int(found.change.valid.sum()), 1),
        "stable_given": found.stable_given,
        "errors_by": list(found.errors.names),
        "attributes": found.attributes,
        "sentences": sentences,
    }


def trend_facts(found: ModelChange) -> dict[str, Any]:
    """Size of the tilt and the bend over the map with their standard errors, metres, and how sure they are."""
    trend = found.trend
    (tilt, tilt_error), (bend, bend_error) = trend.tilt, trend.bend
    return {
        "trend": ("none", "tilt", "bend")[trend.order] if not trend.why else trend.why,
        "trend_taken_off": found.trend_taken_off,
        "tilt_m": tilt,
        "tilt_error_m": tilt_error,
        "tilt_p": trend.p_values[0],
        "bend_m": bend,
        "bend_error_m": bend_error,
        "bend_p": trend.p_values[1],
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

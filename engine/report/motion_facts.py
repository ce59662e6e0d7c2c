"""Figures of motion along the surface for a run record: what the section of the report shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtri

from ...interface.parameters import DisplacementParameters
from ..core.arrays import Float
from ..displacement.chance import beyond_chance, chance_vectors
from ..displacement.displacement import MIN_POINTS_PER_M2, Displacement
from ..displacement.registered import Registered
from ..displacement.status import REASONS, Status
from ..displacement.vectors import CommonMotion, squared_length
from ..displacement.zones import MovingZone

MAX_VARIANCE_FACTOR = 2.0
"""Of the windows' scatter about their common motion, above which the vectors are doubtful."""
MIN_MAJORITY_SHARE = 0.5
"""Of the windows that share the common motion, below which it should not be taken off."""
_COMMON_CONFIDENCE = 0.99  # that still ground has no common motion that is called one
_MAX_ZONES = 100
_MIN_DIP_DEG = 3.0  # a flatter surface has no direction of dip
_MAX_DIRECTION_ERROR_DEG = 45.0  # of one standard error, above which a motion has no direction in words
_WORDS = (
    "down the slope",
    "down and to the left",
    "across, to the left",
    "up and to the left",
    "up the slope",
    "up and to the right",
    "across, to the right",
    "down and to the right",
)
"""Every 45 degrees against the dip, left as one looks down."""


def motion_facts(
    found: Displacement,
    parameters: DisplacementParameters,
    registered: Registered,
    *,
    stable_given: bool = False,
) -> dict[str, Any]:
    """The entry ``displacement`` of a run record; lengths in metres, shares from 0 to 1.

    Args:
        registered: the registration's error, as the vectors hold it.
        stable_given: whether ground was given as stable.
    """
    vectors = found.vectors
    smallest = found.smallest[vectors.measured]
    expected, most = chance_vectors(found)
    return {
        "windows": len(found.cell),
        "spacing_m": parameters.spacing,
        "window_m": parameters.window,
        "wide_window_m": parameters.wide_window if len(found.by_width) > 1 else None,
        "largest_motion_m": parameters.largest_motion,
        "confidence": parameters.vector_confidence,
        "points_per_m2": found.points_per_m2,
        "measured_share": float(vectors.measured.mean()),
        "significant_vectors": int(found.significant.sum()),
        "chance_vectors": expected,
        "chance_vectors_most": most,
        "smallest_p05_m": _quantile(smallest, 0.05),
        "smallest_median_m": _quantile(smallest, 0.5),
        "smallest_p95_m": _quantile(smallest, 0.95),
        "refused": refused(found),
        "registration_known": registered.known,
        "registration_error_m": _along_the_surface(found, registered) if registered.known else None,
        "taken_off_m": [float(part) for part in found.taken_off],
        "common": _common(found.common),
        "stable": _common(found.stable),
        "zone_count": len(found.zones),
        "zones": [_zone_row(found, zone, number) for number, zone in enumerate(found.zones[:_MAX_ZONES], 1)],
        "notes": doubts(found, parameters, stable_given=stable_given),
    }


def refused(found: Displacement) -> list[dict[str, Any]]:
    """Why windows have no vector, with the share of each reason, the largest first."""
    status = found.vectors.status
    shares = {reason: float((status == reason).mean()) for reason in Status if reason != Status.MEASURED}
    order = sorted((reason for reason in shares if shares[reason]), key=lambda reason: -shares[reason])
    return [{"reason": REASONS[reason], "share": shares[reason]} for reason in order]


def doubts(found: Displacement, parameters: DisplacementParameters, *, stable_given: bool) -> list[str]:
    """Sentences on what makes the vectors doubtful."""
    sentences: list[str] = []
    if found.points_per_m2 < MIN_POINTS_PER_M2:
        sentences.append(
            f"The sparser survey has {found.points_per_m2:.2g} ground points a m²; with less than "
            f"{MIN_POINTS_PER_M2:g} the errors are too small on real ground, so that no vector and no zone is claimed."
        )
    for zone in found.doubtful:
        x, y = found.vectors.places[zone.windows, :2].mean(axis=0)
        sentences.append(
            f"Ground of {zone.area:.0f} m² around {x:.1f}, {y:.1f} seems to move {-zone.in_plane[0]:.3f} m up the "
            "slope. This is doubtful and no zone, as gravity moves nothing uphill: check registration and vegetation."
        )
    against = int(np.count_nonzero(found.uphill & beyond_chance(found)))
    if against:
        sentences.append(f"Vectors that point up the slope beyond their error, and are doubtful: {against}.")
    if stable_given and found.stable is None:
        sentences.append(
            "The polygons of stable ground hold fewer than five windows with a motion, so that nothing was taken off; "
            "give larger ones."
        )
    common = found.common
    if common is None:
        return sentences
    if parameters.subtract and not stable_given and common.share < MIN_MAJORITY_SHARE:
        sentences.append(
            f"The common motion that was taken off is shared by {100 * common.share:.0f} % of the windows only; give "
            "polygons of stable ground instead."
        )
    if common.factor > MAX_VARIANCE_FACTOR:
        sentences.append(
            f"The windows scatter about their common motion by {np.sqrt(common.factor):.1f} times their standard "
            "errors: much of the ground moves on its own, or the ground points are no surface, as under plants."
        )
    return sentences


def direction_in_words(off_dip: float, error: float, dip: float) -> str:
    """Where a motion points against the dip: the nearest of eight directions.

    Args:
        off_dip: angle to the direction of dip, degrees, left positive.
        error: one standard error of it, degrees.
        dip: of the surface, degrees.
    """
    if dip < _MIN_DIP_DEG:
        return "on level ground"
    if not error <= _MAX_DIRECTION_ERROR_DEG:
        return "direction uncertain"
    return _WORDS[round(off_dip / 45.0) % len(_WORDS)]


def _zone_row(found: Displacement, zone: MovingZone, number: int) -> dict[str, Any]:
    length, unit = _length(zone.motion)
    errors = np.sqrt(np.diag(zone.in_plane_covariance))
    level = float(np.hypot(zone.motion[0], zone.motion[1]))
    turn = off_dip_error(zone)
    dip = float(np.degrees(np.arccos(np.clip(_normal(found, zone)[2], -1.0, 1.0))))
    cells = found.vectors.places[zone.windows, :2]
    inside = cells[np.argmin(np.linalg.norm(cells - cells.mean(axis=0), axis=1))]
    return {
        "zone_id": f"M{number:03d}",
        "area_m2": zone.area,
        "length_m": length,
        "length_err_m": float(np.sqrt(unit @ zone.covariance @ unit)),
        "azimuth_deg": float(np.degrees(np.arctan2(zone.motion[0], zone.motion[1])) % 360.0),
        "plunge_deg": float(np.degrees(np.arctan2(-zone.motion[2], level))),
        "along_dip_m": float(zone.in_plane[0]),
        "along_dip_err_m": float(errors[0]),
        "across_m": float(zone.in_plane[1]),
        "across_err_m": float(errors[1]),
        "normal_m": float(zone.in_plane[2]),
        "normal_err_m": float(errors[2]),
        "off_dip_deg": zone.off_dip,
        "off_dip_err_deg": turn,
        "dip_deg": dip,
        "direction": direction_in_words(zone.off_dip, turn, dip),
        "p_map": zone.probability,
        "x": round(float(inside[0]), 2),
        "y": round(float(inside[1]), 2),
    }


def _length(motion: Float) -> tuple[float, Float]:
    length = float(np.linalg.norm(motion))
    return length, motion / max(length, 1e-12)


def off_dip_error(zone: MovingZone) -> float:
    """One standard error (degrees) of a zone's direction against the dip."""
    length, unit = _length(zone.in_plane[:2])
    across, covariance = np.array([-unit[1], unit[0]]), zone.in_plane_covariance[:2, :2]
    return float(np.degrees(np.arctan2(np.sqrt(across @ covariance @ across), length)))


def _normal(found: Displacement, zone: MovingZone) -> Float:
    return found.facets.frames[int(found.facet[zone.windows[0]])].axes[2]


def _along_the_surface(found: Displacement, registered: Registered) -> float:
    """Median over the windows of the registration's standard error along the surface, in the direction known least."""
    axes = found.vectors.axes
    error = axes @ registered.at(found.vectors.places) @ np.swapaxes(axes, 1, 2)
    return float(np.median(np.sqrt(np.maximum(np.linalg.eigvalsh(error[:, :2, :2])[:, -1], 0.0))))


def _common(motion: CommonMotion | None) -> dict[str, Any] | None:
    if motion is None:
        return None
    statistic = float(squared_length(motion.motion[None], motion.covariance[None])[0])
    return {
        "motion_m": [float(part) for part in motion.motion],
        "beyond_its_error": statistic > float(chdtri(3, 1.0 - _COMMON_CONFIDENCE)),
        "error_m": [float(part) for part in np.sqrt(np.diag(motion.covariance))],
        "share": motion.share,
        "variance_factor": motion.factor if np.isfinite(motion.factor) else None,
    }


def _quantile(values: Float, share: float) -> float | None:
    return float(np.quantile(values, share)) if len(values) else None

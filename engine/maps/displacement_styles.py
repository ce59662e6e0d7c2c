"""QGIS styles of motion along the surface: arrows with the ellipses of their errors, zones, and the raster."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.arrays import Float
from ..core.templates import render
from .palette import DIVERGING, Colour
from .qgis_styles import ramp_qml

_TEMPLATES = Path(__file__).resolve().parent / "styles"
_ALONG_DIP_BAND = 4
OPACITY_BAND = 17
"""Number of the band of ``displacement.tif`` that holds ``opacity_band.opacity`` of its cells; the last one."""
OPACITY_NAME = "Opacity on a map: 255 where the motion is significant, 45 where still ground shows as much"
ELLIPSE_ERRORS = 2.0
"""Standard errors: some 86 % of the true ends lie within."""
_LONGEST_ARROW_SPACINGS = 1.25
_SHORTEST_M = 1e-6


def vectors_qml(magnification: float, *, temporal: bool = False) -> str:
    """Style of the vectors: an arrow that is drawn so many times longer than the motion, and at its end the ellipse of
    two standard errors on the same scale.

    Args:
        temporal: the layer has a row a survey, which the temporal controller shows from ``time_from`` to ``time_to``.
    """
    return _arrows_qml("vectors", magnification, temporal=temporal)


def one_direction_qml(magnification: float, reach: float) -> str:
    """Style of motion that is known in one direction only: an arrow, and at its end a band across it, ``reach`` metres
    to both sides, in which the motion may lie.
    """
    return render(
        _TEMPLATES / "one_direction.qml.j2",
        magnification=f"{magnification:g}",
        errors=f"{ELLIPSE_ERRORS:g}",
        reach=f"{reach:g}",
    )


def velocities_qml(magnification: float) -> str:
    """As ``vectors_qml``, of velocities: an arrow's length is that of the motion in a day times ``magnification``."""
    return _arrows_qml("velocities", magnification)


def moving_zones_qml(magnification: float, *, temporal: bool = False) -> str:
    """Style of the zones that move as one: outline, an arrow from the middle, the motion as label."""
    return _arrows_qml("moving_zones", magnification, temporal=temporal)


def _arrows_qml(template: str, magnification: float, *, temporal: bool = False) -> str:
    return render(
        _TEMPLATES / f"{template}.qml.j2",
        magnification=f"{magnification:g}",
        errors=f"{ELLIPSE_ERRORS:g}",
        temporal=temporal,
    )


def along_dip_qml(limit: float) -> str:
    """Diverging style of the motion down the dip: red downwards, blue upwards, up to ``limit`` metres; pale where the
    motion is not significant (``OPACITY_BAND``).
    """
    stops: list[tuple[float, Colour, int, str]] = []
    for share, down, up in DIVERGING:
        if share:
            stops.append((-share * limit, up, 255, f"{share * limit:.3f} m up the dip"))
        label = f"{share * limit:.3f} m down the dip" if share else "0 m (pale: no significant motion)"
        stops.append((share * limit, down, 255, label))
    return ramp_qml(sorted(stops), "m", band=_ALONG_DIP_BAND, opacity_band=OPACITY_BAND)


def magnification(motion: Float, spacing: float) -> float:
    """How many times as long as in truth arrows of motions (n, 2 or 3), metres, are drawn: a round number.

    Few are then longer than one and a quarter of their ``spacing`` (m), so that they do not run over each other.
    """
    length = np.hypot(*motion[:, :2].T)
    longest = float(np.quantile(length, 0.95)) if len(length) else 0.1
    wanted = _LONGEST_ARROW_SPACINGS * spacing / max(longest, _SHORTEST_M)
    power = 10 ** np.floor(np.log10(wanted))
    return float(max(step for step in (1, 2, 5) if step * power <= wanted or step == 1) * power)

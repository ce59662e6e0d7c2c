"""QGIS styles of motion along the surface: arrows with the ellipses of their errors, zones, and the raster."""

from __future__ import annotations

from pathlib import Path

from ..core.templates import render
from .palette import DIVERGING, Colour
from .qgis_styles import ramp_qml

_TEMPLATES = Path(__file__).resolve().parent / "styles"
_ALONG_DIP_BAND = 4
_ELLIPSE_ERRORS = 2.0  # standard errors: some 86 % of the true ends lie within


def vectors_qml(magnification: float, *, temporal: bool = False) -> str:
    """Style of the vectors: an arrow that is drawn so many times longer than the motion, and at its end the ellipse of
    two standard errors on the same scale.

    Args:
        temporal: the layer has a row a survey, which the temporal controller shows from ``time_from`` to ``time_to``.
    """
    return _arrows_qml("vectors", magnification, temporal=temporal)


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
        errors=f"{_ELLIPSE_ERRORS:g}",
        temporal=temporal,
    )


def along_dip_qml(limit: float) -> str:
    """Diverging style of the motion down the dip: red downwards, blue upwards, up to ``limit`` metres."""
    stops: list[tuple[float, Colour, int, str]] = []
    for share, down, up in DIVERGING:
        if share:
            stops.append((-share * limit, up, 255, f"{share * limit:.3f} m up the dip"))
        stops.append((share * limit, down, 255, f"{share * limit:.3f} m down the dip" if share else "0 m"))
    return ramp_qml(sorted(stops), "m", band=_ALONG_DIP_BAND)

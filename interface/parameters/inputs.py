"""Parameters of reading clouds."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class InputParameters(ParameterSet, record_name="inputs", title="Input"):
    """How the input clouds are to be read."""

    crs: str = _parameter(
        "",
        "Coordinate reference system",
        "Used instead of what the cloud declares, such as EPSG:32651. Empty: the cloud's own. Needed where a cloud "
        "declares none or a wrong one.",
    )
    height_unit: str = _parameter(
        "auto",
        "Unit of heights",
        "Unit of z. auto: the vertical unit of the reference system, else its horizontal unit.",
        choices=("auto", "metre", "foot", "us-survey-foot"),
        advanced=True,
    )

"""Parameters of the report."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class ReportParameters(ParameterSet, record_name="report"):
    """Profiles for the report."""

    zone_profiles: int = _parameter(
        3,
        "Profiles through zones",
        "A profile is taken down the slope through this many zones, the most severe first. Larger makes a longer "
        "report. 0: none.",
        bounds=(0, 50),
    )
    profile_field: str = _parameter(
        "",
        "Field with the profiles' names",
        "Field of the profiles' lines that names them. Empty: name, label, profile or id, where there is one.",
        advanced=True,
    )

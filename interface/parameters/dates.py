"""Parameters of the days of surveys."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class DateParameters(ParameterSet, record_name="dates", title="Input"):
    """What is done where the days of surveys and their files disagree."""

    trust_dates: bool = _parameter(
        False,
        "Trust the given days",
        "Continues where GPS times, names or creation days of the files say that the surveys are in reversed order. "
        "Off: they are refused, because swapped surveys turn raising into lowering.",
        advanced=True,
    )

"""Parameters of output folders."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class OutputParameters(ParameterSet, record_name="outputs", title="Output"):
    """What is done with results that the output folder already holds."""

    overwrite: bool = _parameter(
        False,
        "Overwrite earlier results",
        "Replaces the results in the output folder; reviews that were entered in the tables of zones are carried over "
        "to the zones that continue. Off: a folder that holds results is refused.",
    )

"""Parameters of clouds that are compared as they are."""

from __future__ import annotations

from dataclasses import dataclass

from .specification import ParameterSet, _parameter


@dataclass(frozen=True)
class SurfaceParameters(ParameterSet, record_name="surface", title="Input"):
    """Which points are taken of clouds that are compared as they are."""

    ground: str = _parameter(
        "auto",
        "Ground points",
        "Which points are the ground. auto: all, and a raw survey with vegetation is refused. class_2: those of class "
        "2. as_is: all, whatever they are, as for rock faces and structures that look like plants.",
        choices=("auto", "class_2", "as_is"),
    )

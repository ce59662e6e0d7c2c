"""The memory that a command may take, in parameter sets."""

from __future__ import annotations

from typing import Any

from .specification import AUTO, _parameter


def memory_for(label: str, help: str) -> Any:  # noqa: A002 - the word users know
    """A field for how much memory may be taken; ``help`` says what becomes of what needs more, and what auto takes."""
    return _parameter(AUTO, label, help, kind=float, unit="GB", bounds=(0.05, 1024.0), advanced=True)


def memory_for_points() -> Any:
    """The field where clouds that need more are measured in parts."""
    return memory_for(
        "Memory for the points",
        "Clouds that need more stay on the disk and are measured in parts, with the same results. Larger has more of "
        "the points in memory at a time. auto: half of the machine's memory.",
    )

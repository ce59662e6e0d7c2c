"""What a command hands back to who called it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...interface.protocol import DONE


@dataclass(frozen=True)
class RunResult:
    """What a run wrote and measured.

    Attributes
    ----------
    outputs : mapping of str to Path
        The files by name, such as ``elevation_change``, ``zones``, ``report``, ``run``.
    figures : mapping of str to Any
        The figures of the run record, such as ``zone_count``, ``lod_median_m``; lengths in metres.
    warnings : tuple of str
        What the user should know, one sentence each.
    conclusion : tuple of str
        What was found, in a few sentences, where the command says it itself; else it is made of the figures.
    exit_code : int
        Of the command that ends with this result: ``DONE`` or ``SOME_FAILED``.
    """

    outputs: Mapping[str, Path]
    figures: Mapping[str, Any]
    warnings: tuple[str, ...] = ()
    conclusion: tuple[str, ...] = ()
    exit_code: int = DONE

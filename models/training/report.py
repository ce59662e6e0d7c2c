"""The report of a training, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...engine.core.templates import render
from ..configuration import CLASSES

_TEMPLATE = Path(__file__).resolve().parent / "templates" / "report.md.j2"


def training_report(facts: dict[str, Any], metrics: dict[str, Any], digest: str, warnings: Sequence[str]) -> str:
    """What was trained on what, and how good it is on what it was not trained on.

    Args:
        facts: as ``workflows.train`` makes them.
        metrics: ``cross_validation`` (``tuning.pooled_scores``) and ``calibration``, None where there is none.
        digest: SHA-256 of the weights.
    """
    return render(
        _TEMPLATE,
        facts=facts,
        scores=metrics["cross_validation"],
        found=metrics["calibration"],
        digest=digest,
        warnings=warnings,
        classes=list(CLASSES),
    )

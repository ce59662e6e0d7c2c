"""The page of a corridor: its slopes in the order in which they should be looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ...interface.language import current_language
from ..core.templates import render

_TEMPLATES = Path(__file__).resolve().parent / "templates"


def corridor_page(
    done: Sequence[Any],
    failed: Sequence[tuple[str, str]],
    alerts: Sequence[Mapping[str, Any]],
    facts: Mapping[str, Any],
) -> str:
    """The page as HTML; every text that comes from a file is escaped.

    Args:
        done: slopes with the fields of ``ranking.Ranked`` of the batch; ``report`` is a path from the page.
        failed: slope and sentence.
        alerts: open events.
        facts: ``software``, ``manifest``, ``count`` (of all slopes) and ``zones``.
    """
    css = Markup((_TEMPLATES / "report.css").read_text(encoding="utf-8"))
    shown = [{name: _shown(name, getattr(slope, name)) for name in slope.__dataclass_fields__} for slope in done]
    return render(
        _TEMPLATES / "corridor.html.j2",
        current_language(),
        css=css,
        done=shown,
        failed=failed,
        alerts=alerts,
        open_alerts=len(alerts),
        **facts,
    )


_DECIMALS = {"rate_mm_day": 2, "volume_m3": 2, "largest_m": 2, "chainage": 0}


def _shown(name: str, value: Any) -> Any:
    """A figure as people read it."""
    if name not in _DECIMALS:
        return value
    return "–" if value is None else f"{value + 0.0:,.{_DECIMALS[name]}f}"

"""Text from jinja2 templates in a folder of the package."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Undefined


def render(template: Path, **values: Any) -> str:
    """The text that ``template`` makes of ``values``.

    Values are escaped for HTML and XML, except in Markdown (``.md.j2``). A name that a template uses and that nobody
    gives is an error, except in HTML: records of older versions lack some entries.
    """
    _, kind, _ = template.name.rsplit(".", 2)
    return _environment(template.parent, kind).get_template(template.name).render(**values)


@lru_cache
def _environment(folder: Path, kind: str) -> Environment:
    return Environment(
        loader=FileSystemLoader(folder),
        autoescape=kind != "md",
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=Undefined if kind == "html" else StrictUndefined,
    )

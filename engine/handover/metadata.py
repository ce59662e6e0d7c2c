"""Metadata by ISO 19115 as ISO/TS 19139 has it in XML (http://www.isotc211.org/2005/gmd, GML 3.2)."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

from ..core.errors import EngineError
from ..core.staged_outputs import atomic_output
from ..core.templates import render
from .about import About

_TEMPLATE = Path(__file__).resolve().parent / "templates" / "iso19139.xml.j2"
GMD = "http://www.isotc211.org/2005/gmd"


def write_metadata(path: Path, about: About, formats: Iterable[str]) -> None:
    """Write the document; ``formats`` are the names of what is handed over."""
    text = render(_TEMPLATE, about=about, formats=list(formats))
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise EngineError(f"{path.name} is no XML: {error}") from error
    if root.tag != f"{{{GMD}}}MD_Metadata":
        raise EngineError(f"{path.name} does not begin with its element")
    with atomic_output(path) as partial:
        partial.write_text(text, encoding="utf-8", errors="xmlcharrefreplace", newline="\n")

"""Typst makes the PDF: fonts that are embedded, one call, a check of what came out."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

from matplotlib import get_data_path
from matplotlib.font_manager import get_font

from ....interface.language import ENGLISH, current_language
from ...core.errors import EngineError, InputError
from ...core.temporary_folders import temporary_folder
from ...maps.picture_words import chinese_font, chinese_font_files
from .blocks import Document

TEMPLATE = Path(__file__).resolve().parents[1] / "templates" / "signed" / "report.typ"
_LATIN = "DejaVu Sans"
_HAN = re.compile(r"[\u3000-\u303f\u3400-\u4dbf\u4e00-\u9fff\uff00-\uffef]")
_NO_TYPST = (
    "The package typst, which makes the PDF, is not installed; set the engine up again, or install it with: "
    "pip install 'slopewatch[pdf]'."
)
_NO_FONT = (
    "A PDF in Chinese needs a font with Chinese letters, and none was found on this computer; install one, such as "
    "Noto Sans CJK SC, or choose English."
)


def refuse_without_means() -> None:
    """Refuse early what would fail at the end of a run.

    Raises:
        InputError: Typst is not installed, or the run is in Chinese and no font has its letters.
    """
    if importlib.util.find_spec("typst") is None:
        raise InputError(_NO_TYPST)
    if current_language() != ENGLISH and not chinese_font():
        raise InputError(_NO_FONT)


def typeset(document: Document, head: Mapping[str, Any], day: date, path: Path) -> None:
    """Write the PDF of a document.

    Its bytes depend on the document, the fonts and the version of Typst alone: ``day`` is the only date in it. It
    follows PDF/A-2b, for archives, unless a letter is missing in all fonts.

    Args:
        head: what else the template takes: title, authors, running, foot, page.

    Raises:
        InputError: see ``refuse_without_means``.
        EngineError: Typst refuses the document.
    """
    refuse_without_means()
    import typst

    content = {
        **head,
        "blocks": document.blocks,
        "lang": current_language().split("_")[0],
        "day": [day.year, day.month, day.day],
    }
    families, fonts, has_all = _fonts_of(json.dumps(content, ensure_ascii=False))
    needed = sum(map(len, document.files.values())) + sum(font.stat().st_size for font in fonts)
    with temporary_folder("report", needed_bytes=needed) as folder:
        for font in fonts:
            shutil.copy(font, folder)
        text = json.dumps(content | {"fonts": families}, ensure_ascii=False, sort_keys=True)
        (folder / "content.json").write_text(text, encoding="utf-8", errors="backslashreplace")
        for name, data in document.files.items():
            (folder / name).write_bytes(data)
        source = folder / TEMPLATE.name
        shutil.copy(TEMPLATE, source)
        options: dict[str, Any] = {"root": str(folder), "font_paths": [str(folder)], "ignore_system_fonts": has_all}
        try:
            try:
                pdf = typst.compile(source, pdf_standards="a-2b", **options)
            except typst.TypstError:
                pdf = typst.compile(source, **options)
        except typst.TypstError as error:
            raise EngineError(f"{path.name} could not be typeset: {error}") from error
    path.write_bytes(pdf or b"")


def check_pdf(path: Path) -> None:
    """Raise EngineError if the file is no whole PDF."""
    content = path.read_bytes()
    if not content.startswith(b"%PDF-") or b"%%EOF" not in content[-64:]:
        raise EngineError(f"{path.name} is not sound")


def _fonts_of(text: str) -> tuple[list[str], list[Path], bool]:
    """The families and files of a text's fonts, and whether they have all its letters; the files are to be copied.

    Typst looks through whole folders of fonts, and would take other fonts on other machines for the same letters.
    """
    letters = {ord(c) for c in text if c.isprintable()}
    families = [_LATIN]
    files: list[Path] = []
    known: set[int] = set()
    for path in sorted((Path(get_data_path()) / "fonts" / "ttf").glob("DejaVuSans*.ttf")):
        if path.stem in ("DejaVuSans", "DejaVuSans-Bold", "DejaVuSans-Oblique", "DejaVuSans-BoldOblique"):
            files.append(path)
        if path.stem == "DejaVuSans":
            known |= set(get_font(str(path)).get_charmap())
    if _HAN.search(text) and chinese_font():
        for path in chinese_font_files():
            files.append(path)
            known |= set(get_font(str(path)).get_charmap())
        # the Japanese face is the first in a collection, after which matplotlib names the file
        families += [chinese_font().replace(" JP", " SC"), chinese_font()]
    return families, files, letters <= known

"""Text from jinja2 templates in a folder of the package."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from jinja2 import BaseLoader, Environment, FileSystemLoader, StrictUndefined, Undefined
from markupsafe import Markup

from ...interface.language import ENGLISH, Translator, translator
from .template_messages import chinese_punctuation, translated_template


def render(template: Path, language: str = ENGLISH, /, **values: Any) -> str:
    """The text that ``template`` makes of ``values``, in a language that ``interface.language`` has.

    The template knows the language as ``language``. Values are escaped for HTML and XML, except in Markdown
    (``.md.j2``). A name that a template uses and that nobody gives is an error, except in HTML: records of older
    versions lack some entries.
    """
    _, kind, _ = template.name.rsplit(".", 2)
    text = _environment(template.parent, kind, language).get_template(template.name).render(language=language, **values)
    return chinese_punctuation(text) if language.startswith("zh") else text


class _TranslatedFiles(FileSystemLoader):
    """Templates of a folder, in another language."""

    def __init__(self, folder: Path, translate: Translator) -> None:
        super().__init__(folder)
        self._translate = translate

    def get_source(self, environment: Environment, template: str) -> tuple[str, str, Callable[[], bool]]:
        source, name, is_current = super().get_source(environment, template)
        return translated_template(source, self._translate), name, is_current


@lru_cache
def _environment(folder: Path, kind: str, language: str) -> Environment:
    loader: BaseLoader = FileSystemLoader(folder)
    translate = translator(language)
    if language != ENGLISH:
        loader = _TranslatedFiles(folder, translate)
    return Environment(
        loader=loader,
        autoescape=kind != "md",
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=Undefined if kind == "html" else StrictUndefined,
        finalize=None if language == ENGLISH else partial(_in_language, translate),
    )


def _in_language(translate: Translator, value: Any) -> Any:
    """A word or sentence of a record, translated; what is markup already was made by a template."""
    return translate(value) if isinstance(value, str) and not isinstance(value, Markup) else value

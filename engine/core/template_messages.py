"""Text of HTML templates as messages: what a template says, and the same template in another language.

A message is the text between two block elements or template statements; what is put in is a place, {0}, {1}, and inline
elements stay in it. So templates are written in plain English, and a translation is looked up when one is loaded.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

_BLOCKS = (
    "html|head|body|meta|title|style|header|footer|main|section|figure|figcaption|img|div|p|h[1-4]|ul|ol|li|dl|dt|dd|"
    "table|caption|thead|tbody|tfoot|tr|td|th|nav|svg|details|summary"
)
_CUT = re.compile(
    rf"(\{{%.*?%\}}|\{{#.*?#\}}|</?(?:{_BLOCKS})\b(?:\{{\{{.*?\}}\}}|[^<>])*>|<!DOCTYPE[^>]*>)", re.DOTALL
)
_EXPRESSION = re.compile(r"\{\{.*?\}\}", re.DOTALL)
_TAG = re.compile(r"<[^<>]*>")
_WORD = re.compile(r"[A-Za-z]{2,}")
_PLACE = re.compile(r"\{(\d+)\}")
_CHOICE = re.compile(r"""(?P<before>\{\{\s*|else\s+)"(?P<text>[^"]*)"(?=\s+if\b|\s*\}\})""")
"""Words within an expression that chooses between them."""
_JOIN = re.compile(r"""join\("( and |, )"\)""")
_UNITS = frozenset({"mm", "year", "day", "nbsp", "EPSG"})

Translate = Callable[[str], str]


def template_messages(source: str) -> Iterator[str]:
    """The messages of a template's source, in its order."""
    for run in _CUT.split(source):
        message, expressions = _message(run)
        if message:
            yield message
        for expression in expressions:
            yield from (found["text"] for found in _CHOICE.finditer(expression) if _WORD.search(found["text"]))


def translated_template(source: str, translate: Translate) -> str:
    """The source with its messages translated; what has no translation stays."""
    return "".join(_translated_run(run, translate) for run in _CUT.split(source))


def _message(run: str) -> tuple[str, list[str]]:
    """The message of a run between two cuts, empty where it holds no words, and the expressions in it."""
    expressions = _EXPRESSION.findall(run)
    if _CUT.fullmatch(run):
        return "", expressions
    count = iter(range(len(expressions)))
    text = " ".join(_EXPRESSION.sub(lambda _: f"{{{next(count)}}}", run).split())
    plain = _PLACE.sub("", _TAG.sub("", text))
    words = [word for word in _WORD.findall(plain) if word not in _UNITS]
    is_markup = "<" in plain or ">" in plain or '="' in plain
    return (text if words and not is_markup else ""), expressions


def _translated_run(run: str, translate: Translate) -> str:
    message, expressions = _message(run)
    chosen = [_translated_choice(expression, translate) for expression in expressions]
    if not message:
        replaced = iter(chosen)
        return _EXPRESSION.sub(lambda _: next(replaced), run)
    before, after = run[: len(run) - len(run.lstrip())], run[len(run.rstrip()) :]
    return f"{before}{_PLACE.sub(lambda place: chosen[int(place.group(1))], translate(message))}{after}"


def _translated_choice(expression: str, translate: Translate) -> str:
    chosen = _CHOICE.sub(lambda found: f'{found["before"]}"{translate(found["text"])}"', expression)
    return _JOIN.sub(lambda found: f'join("{_sign(found[1], translate)}")', chosen)


def _sign(english: str, translate: Translate) -> str:
    """What joins the parts of a list: the catalogue's word for the English one, without blanks."""
    made = translate(english.strip())
    return english if made == english.strip() else made


_HAN = r"\u4e00-\u9fff"
_FULL_STOP = re.compile(
    rf"(?:(?<=[{_HAN}）”])|(?<=</data>))\.(?=\s|<|$)"
    rf"|(?<=[0-9A-Za-z%])\.(?=\s*</(?:p|li|dd|td|span|footer|figcaption)>|\s+[{_HAN}])"
)
_BLANKS = re.compile(rf"(?<=[{_HAN}。，；：、）])[ \t\n]+(?=[{_HAN}（“])")


def chinese_punctuation(page: str) -> str:
    """Full stops that a template has outside of its messages, and blanks between Chinese sentences, as Chinese has
    them.
    """
    return _BLANKS.sub("", _FULL_STOP.sub("。", page))

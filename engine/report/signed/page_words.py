"""What the HTML report says, as text: the report to sign takes verdict, figures and limits from it, word for word."""

from __future__ import annotations

from dataclasses import dataclass, field
from html.parser import HTMLParser

_BREAK = "\v"
_VOID = frozenset({"meta", "img", "br", "hr", "link", "input", "source", "wbr", "col"})


@dataclass
class PageWords:
    """Texts of a page: its ``kind`` and ``title``, the ``verdict``, ``cards`` (name, figure, note), the ``warnings``
    and the ``limits`` of what it can say (term, words).
    """

    kind: str = ""
    title: str = ""
    verdict: str = ""
    cards: list[tuple[str, str, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    limits: list[tuple[str, str]] = field(default_factory=list)


def page_words(page: str) -> PageWords:
    """The texts of a report that ``compose`` made."""
    parser = _Reader()
    parser.feed(page)
    parser.close()
    return parser.words


class _Reader(HTMLParser):
    """Follows the open elements by tag and class, and hands over the text of those that are wanted."""

    def __init__(self) -> None:
        super().__init__()
        self.words = PageWords()
        self._open: list[tuple[str, str]] = []
        self._text: list[str] = []
        self._term = ""
        self._card: dict[str, str] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "br":
            self._text.append(_BREAK)
        if tag in _VOID:
            return
        self._open.append((tag, dict(attrs).get("class") or ""))
        if self._wanted():
            self._text = []

    def handle_data(self, data: str) -> None:
        self._text.append(data)

    def handle_endtag(self, tag: str) -> None:
        if self._open and self._open[-1][0] == tag:
            wanted = self._wanted()
            if wanted:
                lines = (" ".join(line.split()) for line in "".join(self._text).split(_BREAK))
                self._take(wanted, ("\n" if wanted == "verdict" else " ").join(line for line in lines if line))
                self._text = []
            if tag == "li" and self._within("ul", "cards"):
                card = self._card
                self.words.cards.append((card.get("label", ""), card.get("figure", ""), card.get("note", "")))
                self._card = {}
            self._open.pop()

    def _within(self, tag: str, kind: str) -> bool:
        return any(one == tag and kind in classes.split() for one, classes in self._open)

    def _wanted(self) -> str:
        """What the innermost open element is for; empty for one that is of no interest."""
        tag, kind = self._open[-1]
        if tag == "p" and kind in ("kind", "verdict"):
            return kind
        if tag == "span" and kind in ("label", "figure", "note") and self._within("ul", "cards"):
            return kind
        if tag == "li" and self._within("section", "warnings"):
            return "warning"
        if tag in ("dt", "dd") and self._within("section", "limits"):
            return tag
        return "title" if tag == "h1" else ""

    def _take(self, wanted: str, text: str) -> None:
        if wanted in ("kind", "title", "verdict"):
            setattr(self.words, wanted, text)
        elif wanted == "warning":
            self.words.warnings.append(text)
        elif wanted == "dt":
            self._term = text
        elif wanted == "dd":
            self.words.limits.append((self._term, text))
        else:
            self._card[wanted] = text

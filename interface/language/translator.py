"""Sentences in another language, found by the sentence itself.

Messages are written as f-strings where they arise, and many are kept (in run.json, in a table of slopes) before anybody
reads them. So a sentence is recognised by its pattern: the catalogue's "The file {0} has no points." fits "The file
a.laz has no points.", and what stands in the places goes into the translation, translated in its turn.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache, partial

_PLACE = re.compile(r"(?<!\{)\{(\w+)\}(?!\})")
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+")
_SEVERAL = re.compile(r"[.!?;]\s")
_LISTS = (("; ", "；"), (": ", "："), (", ", "、"), (" or ", "或"), (" and ", "和"))
"""What parts of a message are joined with, and what Chinese writes there; the earlier ones join longer parts."""
_UNIT = re.compile(r"(.+) (\([^() ]+\))")
_FREE = 2
"""So many of the lists' signs join parts of which some may be unknown, such as a file's name before a colon."""
_MIN_OWN_LETTERS = 8
"""Of a pattern: one with fewer fits too much that it was not written for."""
_MAX_DEPTH = 5
"""Of parts within parts; a message has a sentence, what stands in it, and a list in that."""
_MAX_CHARACTERS = 8000
"""Of a text that is looked up by its pattern: longer ones are not messages."""


class Translator:
    """Translates what a catalogue has; anything else stays as it is.

    Args:
        catalogue: translations by message, with places {0}, {1} or {name} for what changes.
    """

    def __init__(self, catalogue: Mapping[str, str]) -> None:
        stripped = {_numbered(message.strip()): _numbered(text.strip()) for message, text in catalogue.items()}
        self._whole = stripped  # templates ask for messages with their places
        own = {message: _PLACE.sub("", message) for message in stripped if _PLACE.search(message)}
        kept = [message for message, text in own.items() if sum(map(str.isalpha, text)) >= _MIN_OWN_LETTERS]
        # The one with the most text of its own is the most specific.
        kept.sort(key=lambda message: (-len(own[message]), message))
        self._patterns = [(_pattern(message), stripped[message]) for message in kept]
        self._look_up = lru_cache(maxsize=4096)(self._translated)

    def __call__(self, text: str) -> str:
        """``text`` in the language of the catalogue, sentence by sentence as far as it is known."""
        if not text or len(text) > _MAX_CHARACTERS:
            return text
        return self._look_up(text, 0)

    def _translated(self, text: str, depth: int) -> str:
        known = self._known(text, depth)
        if known is not None:
            return known
        if depth >= _MAX_DEPTH:
            return text
        for way in (
            self._by_lines,
            self._by_sentences,
            self._after_a_name,
            self._by_known_parts,
            partial(self._after_a_name, several=True),
            self._before_a_unit,
        ):
            made = way(text, depth + 1)
            if made != text:
                return made
        return self._known(text, depth, several=True) or self._by_lists(text, depth + 1)

    def _known(self, text: str, depth: int, *, several: bool = False) -> str | None:
        """The translation of the whole text; None where there is none. With ``several``, what stands in a place may
        be several sentences.
        """
        stripped = text.strip()
        whole = self._whole.get(stripped)
        if whole is not None:
            return whole
        if depth >= _MAX_DEPTH:
            return None
        for pattern, translation in self._patterns:
            match = pattern.fullmatch(stripped)
            if match and (several or not any(_SEVERAL.search(value) for value in match.groups())):
                values = {name[1:]: self._look_up(value, depth + 1) for name, value in match.groupdict().items()}
                return _filled(translation, values)
        return None

    def _by_lines(self, text: str, depth: int) -> str:
        return "\n".join(self._look_up(line, depth) for line in text.split("\n")) if "\n" in text else text

    def _after_a_name(self, text: str, depth: int, *, several: bool = False) -> str:
        """What follows "2024-05-01: " or "a.laz: ", where it is known as a whole."""
        name, _, rest = text.partition(": ")
        known = self._known(rest, depth, several=several) if rest else None
        return text if known is None else f"{self._look_up(name, depth)}：{known}"

    def _before_a_unit(self, text: str, depth: int) -> str:
        """A label before "(m)"."""
        match = _UNIT.fullmatch(text)
        known = self._known(match[1], depth) if match else None
        return text if match is None or known is None else f"{known} {match[2]}"

    def _by_sentences(self, text: str, depth: int) -> str:
        """Sentence by sentence: the longest beginning that is known, then the rest in the same way."""
        ends = [match.span() for match in _SENTENCE_END.finditer(text)]
        for stop, start in reversed(ends):
            known = self._known(text[:stop], depth)
            if known is not None:
                return _joined(known, text[stop:start], self._look_up(text[start:], depth))
        if ends:
            stop, start = ends[0]
            return _joined(self._look_up(text[:stop], depth), text[stop:start], self._look_up(text[start:], depth))
        return text

    def _by_known_parts(self, text: str, depth: int) -> str:
        return self._by_lists(text, depth, whole=True)

    def _by_lists(self, text: str, depth: int, *, whole: bool = False) -> str:
        """Part by part where parts are joined to a list; a list of short parts, or with ``whole`` any list, only if
        each of them is known.
        """
        end = "。" if text.endswith(".") else ""
        inner = text[:-1] if end else text
        for number, (english, chinese) in enumerate(_LISTS):
            parts = inner.split(english)
            if len(parts) < 2:
                continue
            made = [self._look_up(part, depth) for part in parts]
            changed = [part != one or not any(map(str.isalpha, part)) for part, one in zip(parts, made)]
            if made != parts and (all(changed) or (number < _FREE and not whole)):
                return chinese.join(made) + end
        return text


def _pattern(message: str) -> re.Pattern[str]:
    source, seen = "", set()
    for position, part in enumerate(_PLACE.split(message)):
        if position % 2 == 0:
            source += re.escape(_plain(part))
        elif part in seen:  # the same name stands for the same text
            source += f"(?P=p{part})"
        else:
            seen.add(part)
            source += f"(?P<p{part}>.*?)"
    return re.compile(source, re.DOTALL)


def _filled(translation: str, values: Mapping[str, str]) -> str:
    parts = enumerate(_PLACE.split(translation))
    return "".join(values.get(part, f"{{{part}}}") if number % 2 else _plain(part) for number, part in parts)


def _plain(text: str) -> str:
    return text.replace("{{", "{").replace("}}", "}")


def _numbered(text: str) -> str:
    """``text`` with the places {} of ``str.format`` as {0}, {1}."""
    count = iter(range(len(text)))
    return re.sub(r"\{\}", lambda _: f"{{{next(count)}}}", text)


def _joined(first: str, between: str, second: str) -> str:
    """Two sentences; no blank after full-width punctuation."""
    return f"{first}{second}" if first[-1:] in "。；：！？，、" else f"{first}{between}{second}"

"""Cases of a long benchmark, kept one by one in a file, so that a run that was cut goes on where it stopped."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class KeptCases:
    """What each case gave, by its name; in ``store``, a line of JSON each, or only in memory where that is None.

    A line that was cut short is left out, and its case is measured again. Delete the file after the program changed.
    """

    def __init__(self, store: Path | None = None) -> None:
        self._store = store
        self._found: dict[str, Any] = {}
        if store is None:
            return
        store.parent.mkdir(parents=True, exist_ok=True)
        for line in store.read_text(encoding="utf-8").splitlines() if store.exists() else ():
            try:
                row = json.loads(line)
                self._found[row["case"]] = row["found"]
            except (json.JSONDecodeError, KeyError, TypeError):
                continue

    def get(self, name: str, measure: Callable[[], Any]) -> Any:
        """What case ``name`` gave: as kept, else as ``measure`` gives it now (lists, dicts, numbers, texts)."""
        if name not in self._found:
            self._found[name] = json.loads(json.dumps(measure()))
            self._keep(name)
        return self._found[name]

    def _keep(self, name: str) -> None:
        if self._store is None:
            return
        cut = self._store.exists() and self._store.stat().st_size > 0 and self._store.read_bytes()[-1:] != b"\n"
        with self._store.open("a", encoding="utf-8") as file:
            file.write("\n" * cut + json.dumps({"case": name, "found": self._found[name]}) + "\n")

"""What is wrong in files, each looked at once, for tests that walk over all of them."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[2]
Fault = TypeVar("Fault")


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def nodes_in(text: str) -> tuple[ast.AST, ...]:
    """All nodes of a source."""
    return tuple(ast.walk(ast.parse(text)))


def faults(paths: Iterable[Path], judge: Callable[[Path], Iterable[Fault]]) -> dict[str, list[Fault]]:
    """What ``judge`` finds in each file, by its path from the root; files without a fault are left out."""
    found = {path: list(judge(path)) for path in paths}
    assert found, "there are no files to look at"
    return {path.relative_to(ROOT).as_posix(): wrong for path, wrong in found.items() if wrong}

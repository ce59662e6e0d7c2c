"""The files of a hand-over with their checksums, in one ZIP archive whose bytes depend on theirs alone."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path

from ..core.checksums import sha256
from ..core.errors import EngineError
from ..core.staged_outputs import atomic_output
from ..report.record_shape import inside

CHECKSUMS = "SHA256SUMS"
_MOMENT = (1980, 1, 1, 0, 0, 0)
"""Of all files: the earliest that a ZIP archive can state."""
_DIGITS = 64
"""Of a SHA-256, hexadecimal."""
_READABLE = 0o100644 << 16
_UNIX = 3
_STORED = (".tif", ".laz", ".png", ".pdf")
"""Kinds that are compressed already."""
_BLOCK_B = 1 << 20


def write_checksums(folder: Path, files: Iterable[str]) -> str:
    """The SHA-256 of each file of ``folder``, in the format of ``sha256sum --check``; the name of the file made."""
    lines = [f"{sha256(folder / name)}  {name}\n" for name in sorted(files)]
    with atomic_output(folder / CHECKSUMS) as partial:
        partial.write_text("".join(lines), encoding="utf-8", newline="\n")
    return CHECKSUMS


def named_in(folder: Path) -> set[str]:
    """The files that the checksums in ``folder`` name; none where there are no checksums that can be read."""
    try:
        lines = (folder / CHECKSUMS).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return set()
    names = {
        name
        for line in lines
        if len(digest := line.partition("  ")[0]) == _DIGITS
        for name in [line[len(digest) + 2 :]]
    }
    return {name for name in names if inside(folder, name) is not None}


def write_zip(path: Path, folder: Path, files: Iterable[str]) -> None:
    """The files of ``folder`` as an archive, in the order of their names and without the clock's time."""
    names = sorted(files)
    with (
        atomic_output(path, lambda written: _check(written, names)) as partial,
        zipfile.ZipFile(partial, "w") as archive,
    ):
        for name in names:
            entry = zipfile.ZipInfo(name, _MOMENT)
            entry.external_attr, entry.create_system = _READABLE, _UNIX
            entry.compress_type = zipfile.ZIP_STORED if Path(name).suffix in _STORED else zipfile.ZIP_DEFLATED
            with (folder / name).open("rb") as source, archive.open(entry, "w", force_zip64=True) as target:
                while block := source.read(_BLOCK_B):
                    target.write(block)


def _check(path: Path, names: list[str]) -> None:
    with zipfile.ZipFile(path) as archive:
        if archive.testzip() is not None or archive.namelist() != names:
            raise EngineError(f"{path.name} read back differs from what was written")

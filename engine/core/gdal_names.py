"""Names that GDAL's Python bindings misread: links without those characters stand in for them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from .input_files import check_layer
from .temporary_folders import temporary_folder


def misread(path: Path) -> bool:
    """Whether pyogrio reads ``path`` as another: it drops control characters and splits at ``!`` and ``;``."""
    text = str(path)
    return not text.isprintable() or "!" in text or ";" in text


@contextlib.contextmanager
def readable(path: Path) -> Iterator[Path]:
    """A vector file for GDAL: ``path``, or where it would be misread a link to it, with links to its sidecars.

    Raises:
        InputError: it is no file that GDAL may open, see ``input_files.check_layer``.
    """
    check_layer(path)
    path = path.absolute()
    if not misread(path):
        yield path
        return
    with temporary_folder("link") as folder:
        for sibling in path.parent.iterdir():
            if sibling.stem == path.stem:
                (folder / f"file{sibling.suffix}").symlink_to(sibling)
        yield folder / f"file{path.suffix}"


@contextlib.contextmanager
def writable(path: Path) -> Iterator[Path]:
    """``path``, or where its folder would be misread the same place through a link to the folder."""
    path = path.absolute()
    if not misread(path):
        yield path
        return
    with temporary_folder("link") as folder:
        link = folder / "folder"
        link.symlink_to(path.parent, target_is_directory=True)
        yield link / path.name

"""Writing outputs so that a broken run leaves none: temporary name, check, rename."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from . import lifecycle
from .errors import EngineError, InputError


@contextlib.contextmanager
def atomic_output(path: Path, check: Callable[[Path], None] | None = None) -> Iterator[Path]:
    """A temporary path in ``path``'s folder that becomes ``path`` when the block ends well.

    Args:
        path: the final name; its extension is kept for drivers that look at it.
        check: opens what was written and raises if it is not sound.

    Raises:
        EngineError: the block wrote nothing.
        InputError: the folder does not exist or cannot be written.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"The folder {path.parent} does not exist; create it or choose another output.")
    partial = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    with lifecycle.temporary(partial):
        try:
            yield partial
        except PermissionError as error:
            raise InputError(f"{path} cannot be written ({error.strerror}); choose another output folder.") from error
        if not partial.is_file() or partial.stat().st_size == 0:
            raise EngineError(f"{path.name} was not written")
        if check is not None:
            check(partial)
        _rename(partial, path)


class Stage:
    """The outputs of one run, gathered in a hidden folder until all of them are sound."""

    def __init__(self, directory: Path, folder: Path) -> None:
        self.directory = directory
        self.folder = folder

    def path(self, name: str) -> Path:
        """Where to write the output ``name`` (it may have a subfolder) for now."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def final(self, name: str) -> Path:
        """Where the output ``name`` will be once the run has ended well."""
        return self.directory / name


@contextlib.contextmanager
def staged_outputs(directory: Path, *, last: str = "run.json") -> Iterator[Stage]:
    """Collect outputs for ``directory`` and move them there when the block ends well, ``last`` after all others.

    A folder that this made is removed again when the block fails.

    Raises:
        InputError: the folder cannot be made or written.
    """
    directory = Path(directory).absolute()
    made = [p for p in (directory, *directory.parents) if not p.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=".slopewatch-part-", dir=directory))
    except OSError as error:
        raise InputError(
            f"The output folder {directory} cannot be written ({error.strerror}); choose another one."
        ) from error
    with contextlib.ExitStack() as stack:
        for path in reversed(made):
            stack.enter_context(lifecycle.temporary(path, only_empty=True))
        stack.enter_context(lifecycle.temporary(folder))
        yield Stage(directory, folder)
        files = sorted((p for p in folder.rglob("*") if p.is_file()), key=lambda p: (p.name == last, p))
        for path in files:
            target = directory / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            _rename(path, target)


def refuse_inputs_as_outputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise InputError if an output is also an input."""
    known = {Path(i).resolve() for i in inputs}
    for output in outputs:
        if Path(output).resolve() in known:
            raise InputError(f"The output {output} is also an input; choose another name for the output.")


def refuse_unwritable(path: Path) -> None:
    """Raise InputError, before any work, if a file cannot be written at ``path``."""
    parent = Path(path).absolute().parent
    if not parent.is_dir():
        raise InputError(f"The folder {parent} does not exist; create it or choose another output.")
    if Path(path).is_dir():
        raise InputError(f"The output {path} is a folder; give a file name.")
    try:
        with tempfile.TemporaryFile(dir=parent):
            pass
    except OSError as error:
        raise InputError(f"The folder {parent} cannot be written ({error.strerror}); choose another one.") from error


def _rename(source: Path, target: Path) -> None:
    try:
        os.replace(source, target)
    except OSError as error:
        raise InputError(
            f"{target} cannot be replaced ({error.strerror}); close the program that has it open."
        ) from error

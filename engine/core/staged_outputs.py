"""Writing outputs so that a broken run leaves none: temporary name, check, rename."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from . import cancellation
from .errors import Cancelled, EngineError, InputError
from .part_folders import OWNER, part_folder

_SIDECARS = ("-wal", "-shm", "-journal")
"""Of a GeoPackage that a program has open: they belong to the file that is replaced, and would damage the new one."""
NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_MIN_FREE_BYTES = 100_000_000  # bytes; a run that fails with less left than this most likely failed for that


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
    with cancellation.temporary(partial):
        try:
            yield partial
        except PermissionError as error:
            raise InputError(f"{path} cannot be written ({error.strerror}); choose another output folder.") from error
        except OSError as error:
            if error.errno in NO_SPACE:
                sentence = f"{path} cannot be written ({error.strerror}); free some space or choose another folder."
                raise InputError(sentence) from error
            raise
        if not partial.is_file() or partial.stat().st_size == 0:
            raise EngineError(f"{path.name} was not written")
        if check is not None:
            check(partial)
        _rename(partial, path, path)


class Stage:
    """The outputs of one run, gathered in a hidden folder until all of them are sound."""

    def __init__(self, directory: Path, folder: Path) -> None:
        self.directory = directory
        self.folder = folder
        self.discarded: list[str] = []

    def path(self, name: str) -> Path:
        """Where to write the output ``name`` (it may have a subfolder) for now."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def final(self, name: str) -> Path:
        """Where the output ``name`` will be once the run has ended well."""
        return self.directory / name

    def discard(self, name: str) -> None:
        """Have the output ``name`` of an earlier run removed once this one has ended well."""
        self.discarded.append(name)


@contextlib.contextmanager
def staged_outputs(directory: Path, *, last: str = "run.json") -> Iterator[Stage]:
    """Collect outputs for ``directory`` and move them there when the block ends well, ``last`` after all others.

    A folder that this made is removed again when the block fails.

    Raises:
        InputError: the folder cannot be made or written, or another run is at work that will write ``last`` there.
    """
    directory = Path(directory).absolute()
    made = [p for p in (directory, *directory.parents) if not p.exists()]
    with contextlib.ExitStack() as stack:
        # Made and known to be temporary at once: cancelling in between would leave them.
        with cancellation.uninterrupted():
            try:
                directory.mkdir(parents=True, exist_ok=True)
                folder = stack.enter_context(part_folder(directory, last))
            except OSError as error:
                raise InputError(
                    f"The output folder {directory} cannot be written ({error.strerror}); choose another one."
                ) from error
            for path in reversed(made):
                stack.enter_context(cancellation.temporary(path, only_empty=True))
            stack.enter_context(cancellation.temporary(folder))
        try:
            stage = Stage(directory, folder)
            yield stage
            _move_all(folder, directory, last, stage.discarded)
        except (InputError, Cancelled):
            raise
        except Exception as error:
            _blame_full_disk(directory, error)
            raise


def _move_all(folder: Path, directory: Path, last: str, discarded: Iterable[str] = ()) -> None:
    """Move all files of ``folder`` to ``directory``; if one cannot be moved, what was there before stays.

    Args:
        discarded: names of files in ``directory`` that are to go.
    """
    files = sorted((p for p in folder.rglob("*") if p.is_file() and p.name != OWNER), key=lambda p: (p.name == last, p))
    targets = [directory / path.relative_to(folder) for path in files]
    for target in targets:
        if target.is_dir():
            raise InputError(f"The output {target} is a folder; remove it or choose another output.")
    old = folder / ".replaced"
    old.mkdir()
    replaced: list[tuple[Path, Path]] = []
    moved: list[Path] = []

    def set_aside(target: Path) -> None:
        for place in (target, *(target.with_name(target.name + ending) for ending in _SIDECARS)):
            if place.is_symlink() or place.exists():
                kept = old / str(len(replaced))
                _rename(place, kept, place)
                replaced.append((kept, place))

    with cancellation.uninterrupted():
        try:
            for name in discarded:
                set_aside(directory / name)
            for path, target in zip(files, targets, strict=True):
                _make_folder(target.parent)
                set_aside(target)
                _rename(path, target, target)
                moved.append(target)
        except BaseException:
            for target in moved:
                target.unlink(missing_ok=True)
            for kept, target in replaced:
                os.replace(kept, target)
            raise


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"The output folder {folder} cannot be made ({error.strerror}); choose another output."
        ) from error


def _blame_full_disk(directory: Path, error: Exception) -> None:
    """Raise InputError if the outputs most likely did not fit; native writers do not report it as such."""
    try:
        free = shutil.disk_usage(directory).free
    except OSError:
        return
    reason = f"{type(error).__name__}: {next(iter(str(error).splitlines()), 'no text')}"
    if free < _MIN_FREE_BYTES or (isinstance(error, OSError) and error.errno in NO_SPACE):
        raise InputError(
            f"Writing to {directory} failed, and its disk has {free / 1e6:.1f} MB left; free some space or choose "
            f"another output folder ({reason})."
        ) from error


def refuse_inputs_as_outputs(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise InputError if an output is also an input, or two outputs are one file."""
    known = {Path(i).resolve() for i in inputs}
    taken: set[Path] = set()
    for output in outputs:
        place = Path(output).resolve()
        if place in known:
            raise InputError(f"The output {output} is also an input; choose another name for the output.")
        if place in taken:
            raise InputError(f"Two outputs are to be {output}; give each a name of its own.")
        taken.add(place)


def refuse_other_than_cloud(output: Path) -> None:
    """Raise InputError unless the name of an output cloud ends in .laz or .las."""
    if output.suffix.lower() not in (".laz", ".las"):
        raise InputError(f"The output {output} is to be a point cloud; end its name in .laz or .las.")


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


def _rename(source: Path, target: Path, named: Path) -> None:
    """``named`` is the output that a message names."""
    try:
        os.replace(source, target)
    except OSError as error:
        raise InputError(
            f"{named} cannot be replaced ({error.strerror}); close the program that has it open."
        ) from error

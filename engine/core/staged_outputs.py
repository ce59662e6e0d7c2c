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
from .journal import Journal, sync
from .part_folders import HOLDING, OWNER, part_folder

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
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
            if error.errno in _NO_SPACE:
                sentence = f"{path} cannot be written ({error.strerror}); free some space or choose another folder."
                raise InputError(sentence) from error
            raise
        if not partial.is_file() or partial.stat().st_size == 0:
            raise EngineError(f"{path.name} was not written")
        if check is not None:
            check(partial)
        sync([partial])
        try:
            os.replace(partial, path)
        except OSError as error:
            raise InputError(
                f"{path} cannot be replaced ({error.strerror}); close the program that has it open."
            ) from error
        sync([path.parent])


class Stage:
    """The outputs of one run for one folder, gathered in a hidden folder until all of them are sound."""

    def __init__(self, directory: Path, folder: Path) -> None:
        self.directory = directory
        self.folder = folder
        self.discarded: list[str] = []
        self.others: dict[Path, Stage] = {}

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

    def beside(self, folder: Path) -> Stage:
        """The outputs for one of the folders that ``staged_outputs`` was given."""
        return self.others.get(folder.resolve(), self)

    def files(self, last: str) -> list[Path]:
        """What was written, ``last`` after all others."""
        found = (path for path in self.folder.rglob("*") if path.is_file() and path.name != OWNER)
        return sorted(found, key=lambda path: (path.name == last, path))


@contextlib.contextmanager
def staged_outputs(directory: Path, *others: Path, last: str = "run.json") -> Iterator[Stage]:
    """Collect outputs for ``directory`` and move them there when the block ends well, ``last`` after all others.

    Outputs for ``others``, more folders, are moved with them: all or none (see ``journal``). A folder that this made is
    removed again when the block fails.

    Raises:
        InputError: a folder cannot be made or written, or another run is at work that will write ``last`` there.
    """
    with contextlib.ExitStack() as stack:
        stage = _staged(Path(directory).absolute(), last, stack)
        for other in others:
            if other.resolve() not in (directory.resolve(), *stage.others):
                stage.others[other.resolve()] = _staged(Path(other).absolute(), last, stack)
        try:
            yield stage
            _move_all(stage, last)
        except (InputError, Cancelled):
            raise
        except Exception as error:
            _blame_full_disk(stage.directory, error)
            raise


def _staged(directory: Path, last: str, stack: contextlib.ExitStack) -> Stage:
    made = [p for p in (directory, *directory.parents) if not p.exists()]
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
        stack.enter_context(cancellation.temporary(folder, unless=HOLDING))
    return Stage(directory, folder)


def _move_all(stage: Stage, last: str) -> None:
    """Move all files to their folders; if one cannot be moved, what was there before stays."""
    journal = Journal(stage.folder, [other.folder for other in stage.others.values()])
    for place in (*stage.others.values(), stage):  # the folder of the record is the last one
        for name in place.discarded:
            journal.add(place.folder, place.directory / name, None)
        for path in place.files(last):
            target = place.directory / path.relative_to(place.folder)
            if target.is_dir():
                raise InputError(f"The output {target} is a folder; remove it or choose another output.")
            journal.add(place.folder, target, path)
    journal.sync_new()
    with cancellation.uninterrupted():
        journal.carry_out()


def _blame_full_disk(directory: Path, error: Exception) -> None:
    """Raise InputError if the outputs most likely did not fit; native writers do not report it as such."""
    try:
        free = shutil.disk_usage(directory).free
    except OSError:
        return
    reason = f"{type(error).__name__}: {next(iter(str(error).splitlines()), 'no text')}"
    if free < _MIN_FREE_BYTES or (isinstance(error, OSError) and error.errno in _NO_SPACE):
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

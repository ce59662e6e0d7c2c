"""The journal of a replacement: all files that a run moves, listed on the disk, so that a killed run can be undone.

A run has its new files in part folders, a hidden one in each folder that it writes to. Each step of a replacement is on
the disk before the next one begins:

1. the new files;
2. the journal, in the part folder of the run record; each other part folder gets a file that names that one;
3. every earlier file is set aside in a part folder;
4. every new file gets its name, the run record last;
5. the journal is renamed to ``DONE``. This one rename makes the results the new ones.

As long as the journal is there, ``undo`` gives the earlier files their names back. It can be killed too, and repeated.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from .errors import InputError
from .json_shapes import fields, read_json, rows, text

JOURNAL, DONE, ELSEWHERE, ASIDE = ".journal", ".done", ".journal-elsewhere", ".aside"
SIDECARS = ("-wal", "-shm", "-journal")
"""Of a GeoPackage that a program has open: they belong to the file that is replaced, and would damage the new one."""
_NAME = text(r"[^\0]+", "a path")
_SHAPE = fields(
    {
        "aside": rows(rows(_NAME, 2, 2)),
        "placed": rows(rows(_NAME, 3, 3)),
        "made": rows(_NAME),
        "parts": rows(_NAME),
    }
)
_DAMAGED = (
    "A run was killed while it replaced results, and its journal {path} cannot be read ({why}); move the hidden folder "
    "of the journal elsewhere."
)
_NO_FOLDER_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)  # said by file systems that cannot do it


@dataclass
class Journal:
    """What a replacement moves.

    Args:
        folder: part folder of the run record.
        parts: the other part folders.
        aside: names of earlier files, and their places in a part folder.
        placed: new files in a part folder, their names, and their stamps (see ``_stamp``).
        made: folders that the replacement makes, each after the one that it lies in.
    """

    folder: Path
    parts: Sequence[Path] = ()
    aside: dict[Path, Path] = field(default_factory=dict)
    placed: list[tuple[Path, Path, str]] = field(default_factory=list)
    made: list[Path] = field(default_factory=list)

    def add(self, part: Path, name: Path, new: Path | None) -> None:
        """Have the file ``name`` replaced by ``new``, or removed where that is None; its sidecars go as well."""
        for place in (name, *_sidecars(name)):
            if os.path.lexists(place) and place not in self.aside:
                self.aside[place] = part / ASIDE / str(len(self.aside))
        if new is not None:
            self.placed.append((new, name, _stamp(new)))
            missing = [folder for folder in name.parents if not folder.exists() and folder not in self.made]
            self.made += reversed(missing)

    def sync_new(self) -> None:
        """Have the new files written to the disk, before all else; that may take a while.

        Raises:
            InputError: a file is to go to a folder that is a link to elsewhere, which could not be undone.
        """
        _refuse_others([*self.aside, *(name for _, name, _ in self.placed)], self.folder, self.parts)
        all_parts = (self.folder, *self.parts)
        folders = {folder for new, _, _ in self.placed for folder in new.parents}
        sync(new for new, _, _ in self.placed)
        sync(folder for folder in folders if any(folder.is_relative_to(part) for part in all_parts))

    def carry_out(self) -> None:
        """Give the new files their names; if that fails, the earlier ones have theirs.

        Raises:
            InputError: a file cannot be moved, or a folder not be made.
        """
        try:
            self._write()
            self._move()
        except BaseException:
            if (self.folder / JOURNAL).exists():
                self.undo()
            raise
        self._forget()

    def _write(self) -> None:
        for part in (self.folder, *self.parts):
            (part / ASIDE).mkdir()
            if part != self.folder:
                (part / ELSEWHERE).write_bytes(os.fsencode(self.folder))
                sync([part / ELSEWHERE])
            sync([part, part.parent])
        document = {
            "aside": [[self._text(path) for path in pair] for pair in self.aside.items()],
            "placed": [[self._text(new), self._text(name), stamp] for new, name, stamp in self.placed],
            "made": [self._text(path) for path in self.made],
            "parts": [str(part) for part in self.parts],
        }
        fresh = self.folder / f"{JOURNAL}.new"
        fresh.write_text(json.dumps(document), encoding="ascii")
        sync([fresh])
        os.replace(fresh, self.folder / JOURNAL)
        sync([self.folder, self.folder.parent])

    def _text(self, path: Path) -> str:
        """Relative to the folder of the run record where it lies there, so that this folder may be moved."""
        root = self.folder.parent
        return str(path.relative_to(root) if path.is_relative_to(root) else path)

    @classmethod
    def read(cls, folder: Path) -> Journal:
        """The journal in a part folder.

        Raises:
            InputError: it is damaged, or names files outside the folders that the run wrote to.
        """
        known = read_json(folder / JOURNAL, _SHAPE, _DAMAGED)
        root = folder.parent
        parts = [Path(part) for part in known["parts"]]
        journal = cls(
            folder,
            parts,
            {root / name: root / kept for name, kept in known["aside"]},
            [(root / new, root / name, stamp) for new, name, stamp in known["placed"]],
            [root / made for made in known["made"]],
        )
        named = [part for part in parts if elsewhere(part) == folder]
        places = [path for new, name, _ in journal.placed for path in (new, name)]
        _refuse_others([*journal.aside, *journal.aside.values(), *places, *journal.made], folder, named)
        return journal

    def _move(self) -> None:
        for name, kept in self.aside.items():
            _rename(name, kept, name)
        sync(_folders_of([*self.aside, *self.aside.values()]))
        for folder in self.made:
            _make_folder(folder)
        for new, name, _ in self.placed:
            _rename(new, name, name)
        sync(_folders_of([*self.made, *(path for new, name, _ in self.placed for path in (new, name))]))
        os.replace(self.folder / JOURNAL, self.folder / DONE)
        sync([self.folder])

    def undo(self) -> None:
        """Give the earlier files their names back, and remove the new ones; then the journal goes.

        A new file that was changed since it got its name is kept under another one, and so is a file that has taken
        the name of an earlier one.

        Raises:
            InputError: a file cannot be moved; the journal is there still.
        """
        for new, name, stamp in reversed(self.placed):
            waits = name not in self.aside or os.path.lexists(self.aside[name])
            if waits and os.path.lexists(name) and not os.path.lexists(new):
                _take_away(name, changed=_stamp(name) != stamp)
        for name, kept in self.aside.items():
            if os.path.lexists(kept):
                if os.path.lexists(name):
                    _take_away(name, changed=True)
                _rename(kept, name, name)
        for folder in reversed(self.made):
            with contextlib.suppress(OSError):  # it was not made, or something is in it
                folder.rmdir()
        sync(_folders_of([*self.aside, *self.aside.values(), *(name for _, name, _ in self.placed)]))
        (self.folder / JOURNAL).unlink()
        sync([self.folder])
        self._forget()

    def _forget(self) -> None:
        for part in self.parts:
            (part / ELSEWHERE).unlink(missing_ok=True)


def elsewhere(part: Path) -> Path | None:
    """The part folder with the journal that a part folder names; None if it names none."""
    try:
        return Path(os.fsdecode((part / ELSEWHERE).read_bytes()))
    except (OSError, ValueError):
        return None


def other_parts(folder: Path) -> list[Path]:
    """The other part folders that the journal in a part folder names; none where there is no journal."""
    for name in (JOURNAL, DONE):
        with contextlib.suppress(OSError, InputError):
            return [Path(part) for part in read_json(folder / name, _SHAPE, _DAMAGED)["parts"]]
    return []


def sync(paths: Iterable[Path]) -> None:
    """Have files, and folders with the names in them, written to the disk; Windows does that for files only."""
    for path in paths:
        is_folder = path.is_dir()
        if is_folder and os.name == "nt":
            continue
        descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if not is_folder or error.errno not in _NO_FOLDER_SYNC:
                raise
        finally:
            os.close(descriptor)


def _refuse_others(paths: Iterable[Path], folder: Path, parts: Iterable[Path]) -> None:
    """Raise InputError unless each path lies in a folder that the run writes to: nobody's journal moves other files."""
    roots = [os.path.realpath(part.parent) for part in (folder, *parts)]
    for path in paths:
        parent = Path(os.path.realpath(path.parent))
        if path.name == ".." or not any(parent.is_relative_to(root) for root in roots):
            raise InputError(
                f"{path} leads out of the folder {folder.parent}, so it cannot be replaced safely; choose another "
                "output folder."
            )


def _stamp(path: Path) -> str:
    """Size and time of change, which a rename keeps."""
    status = os.lstat(path)
    return f"{status.st_size} {status.st_mtime_ns}"


def _sidecars(path: Path) -> list[Path]:
    return [path.with_name(path.name + ending) for ending in SIDECARS]


def _take_away(path: Path, *, changed: bool) -> None:
    """Remove a new file with its sidecars; one that people have changed gets another name."""
    number, other = 1, path.with_stem(f"{path.stem}_edited")
    while os.path.lexists(other):
        number += 1
        other = path.with_stem(f"{path.stem}_edited_{number}")
    for place in (*_sidecars(path), path):  # itself last: while it is there, this can be repeated
        if os.path.lexists(place):
            if changed:
                _rename(place, other.with_name(other.name + place.name.removeprefix(path.name)), path)
            else:
                place.unlink()


def _rename(source: Path, target: Path, named: Path) -> None:
    """``named`` is the output that a message names."""
    try:
        os.replace(source, target)
    except OSError as error:
        raise InputError(
            f"{named} cannot be replaced ({error.strerror}); close the program that has it open."
        ) from error


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"The output folder {folder} cannot be made ({error.strerror}); choose another output."
        ) from error


def _folders_of(paths: Iterable[Path]) -> set[Path]:
    return {path.parent for path in paths if path.parent.is_dir()}

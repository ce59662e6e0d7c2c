"""The door for files that people give, see ``interface.input_files``; what it refuses is an ``InputError``."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ...interface import input_files
from ...interface.input_files import (
    CLOUD,
    CLUSTER,
    FIELD_NAMES,
    LABELS,
    LAYER,
    MEASURED,
    PART,
    RASTER,
    RECORD,
    TABLE,
    TRAJECTORY,
    TRANSFORM,
    WEIGHTS,
    InputKind,
    is_geodatabase,
)
from .errors import InputError
from .messages import shown


class MissingInput(InputError, FileNotFoundError):
    """The file does not exist; for readers that say in their own words what is missing."""


def open_input(path: Path | str, kind: InputKind) -> BinaryIO:
    """The file, open to be read from its beginning.

    Raises:
        MissingInput: it does not exist.
        InputError: no regular file, not to be opened, larger than its kind, or of another format.
    """
    with _refusals():
        return input_files.open_input(Path(path), kind)


def read_input(path: Path | str, kind: InputKind) -> bytes:
    """The bytes of a file whose kind has a size limit; raises as ``open_input``."""
    with _refusals():
        return input_files.read_input(Path(path), kind)


def check_input(path: Path | str, kind: InputKind) -> None:
    """Raise as ``open_input``; for readers that take a name."""
    with _refusals():
        input_files.check_input(Path(path), kind)


def check_layer(path: Path | str) -> None:
    """``check_input`` of a vector file, which may be the folder of a file geodatabase."""
    path = Path(path)
    with _refusals():
        for part in input_files.parts_of(path):
            input_files.check_input(part, input_files.PART if part is not path else input_files.LAYER)


def parts_of(path: Path | str) -> list[Path]:
    """The file, or the files of a file geodatabase; InputError for another folder is raised where it is opened."""
    with _refusals():
        return input_files.parts_of(Path(path))


@contextmanager
def _refusals() -> Iterator[None]:
    try:
        yield
    except input_files.MissingFileError as error:
        raise MissingInput(str(error)) from error
    except input_files.UnusableFileError as error:
        raise InputError(str(error)) from error


_KINDS = {
    **dict.fromkeys(
        ("roi", "stable", "profiles", "centreline", "classes", "corrections", "segments", "polygons", "plan", "layer"),
        LAYER,
    ),
    **dict.fromkeys(("tasks", "export"), LABELS),
    "transform": TRANSFORM,
    "field_names": FIELD_NAMES,
    "fields": FIELD_NAMES,
    "alerts": TABLE,
    "run": RECORD,
    "trajectory": TRAJECTORY,
    **dict.fromkeys(("cloud", "reference", "moving", "survey"), CLOUD),
    **dict.fromkeys(("epoch", "season", "terrain"), MEASURED),
    "picture": RASTER,
    "cluster": CLUSTER,
    "weights": WEIGHTS,
}
"""By the first word of an input's role in the run record."""


def refuse_unusable(inputs: Iterable[tuple[str, Path | None]]) -> None:
    """Raise InputError, before any work, for an input that is there and that its reader would refuse as a file.

    What is missing is left to the readers, which know what it is.

    Args:
        inputs: role and path of each.
    """
    for role, path in inputs:
        if path is None:
            continue
        kind = _KINDS.get(role.partition(" ")[0], PART)
        with contextlib.suppress(MissingInput):
            if kind is LAYER or is_geodatabase(Path(path)):
                check_layer(path)
            else:
                check_input(path, kind)


def refuse_odd_outputs(outputs: Iterable[Path]) -> None:
    """Raise InputError for an output whose name a pipe or device has, or a link that leads back to itself."""
    for output in outputs:
        try:
            mode = os.stat(output).st_mode
        except OSError as error:
            if error.errno == errno.ELOOP:
                raise InputError(
                    f"The output {shown(output)} is a link that leads back to itself; remove it."
                ) from error
            continue  # mostly there is none yet; the rest is said where it is written
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise InputError(f"The output {shown(output)} is a pipe or a device; choose another name.")

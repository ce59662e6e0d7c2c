"""The one door for files that people give: a regular file, of a size its kind can have, with the first bytes of it.

Everything else is refused before it is read: a pipe or a device would stop the program or fill its memory.
"""

from __future__ import annotations

import errno
import os
import stat
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

_MB = 1_000_000
_SHOWN = 300  # characters of a name in a sentence


@dataclass(frozen=True)
class InputKind:
    """What a file may be.

    Attributes
    ----------
    most_bytes : a larger file is refused; 0: any size, as its reader takes it in parts of bounded size.
    most_text_bytes : the same for JSON and XML, which take their readers longer; 0: as others.
    starts : the first bytes of the formats that are read; any where it is empty.
    refused : the first bytes of formats that are not read.
    formats : these formats, for the sentence.
    """

    most_bytes: int = 0
    most_text_bytes: int = 0
    starts: tuple[bytes, ...] = ()
    refused: tuple[bytes, ...] = ()
    formats: str = ""


# Limits in bytes; the reason of each is what the reader makes of the largest file, at most half a gigabyte.
SETTINGS = InputKind(16 * _MB)  # JSON of lists and objects takes 25 times its size; the record of a corridor has 3 MB
TOML_SETTINGS = InputKind(250_000)  # all settings there are take 10 kB; the parser's time grows by the square
RECORD = InputKind(32 * _MB)  # a run record; its values are counted before they are read
TRANSFORM = InputKind(32 * _MB)  # with heights of a bent registration every metre over 1 km²
FIELD_NAMES = InputKind(1 * _MB)  # 10,000 names
TABLE = InputKind(16 * _MB)  # manifests and alert levels: 100,000 lines; their cells are counted before they are read
RUN_TABLE = InputKind(100 * _MB)  # the profiles of a run: 1,000 of 1,000 cells
CLUSTER = InputKind(1 * _MB)  # some names and numbers
LABELS = InputKind(64 * _MB)  # a Label Studio export with 100 brush masks; its values are counted, too
TRAJECTORY = InputKind(160 * _MB)  # four hours at 200 Hz; read line by line
LAYER = InputKind(
    256 * _MB,  # GDAL and shapely take three times its size; a country's roads or 1,000,000 corners fit
    most_text_bytes=32 * _MB,  # 250,000 polygons of GeoJSON; 2,000,000 in 240 MB took 17 s of a processor and more
    # archives, whose content may have any size, and files that name other files or addresses; of ZIP, which shapefiles
    # and KML come in, the sizes are added up
    refused=(b"\x1f\x8b", b"7z\xbc\xaf", b"<OGR", b"<VRT", b"<GDAL"),
    formats="a GeoPackage, shapefile, GeoJSON, KML or FlatGeobuf",
)
RASTER = InputKind(
    starts=(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), formats="a GeoTIFF"
)  # its cells are counted before they are read
CLOUD = InputKind(starts=(b"LASF",), formats="a LAS or LAZ file")  # read in parts
MEASURED = InputKind(starts=(*CLOUD.starts, *RASTER.starts), formats="a LAS or LAZ file, or a GeoTIFF")
WEIGHTS = InputKind(256 * _MB)  # held in memory; the networks here have 2 MB
PICTURE = InputKind(256 * _MB)  # a labelled picture of 10,000 by 10,000 pixels; held in memory
PHOTO = InputKind(100 * _MB)  # of a camera; its pixels are counted before they are read
PART = InputKind()  # of a file that is several, such as a geodatabase, to be hashed only

_LONGEST_START = 16
_ZIP = b"PK\x03\x04"
_SPACE = b"\xef\xbb\xbf \t\r\n"  # before the text of a format
_MAX_FOLDER_FILES = 10_000  # of a file geodatabase; ten tables have a hundred


class UnusableFileError(Exception):
    """A file cannot be used; the text is one sentence that names it and the remedy."""


class MissingFileError(UnusableFileError):
    """There is no such file."""


def open_input(path: Path, kind: InputKind) -> BinaryIO:
    """The file, open to be read from its beginning.

    Raises
    ------
    UnusableFileError : missing, no regular file, not to be opened, larger than its kind, or of another format.
    """
    with _named(path):
        _refuse_irregular(path, os.stat(path).st_mode)  # a device may act when it is opened
        flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        stream = os.fdopen(os.open(path, flags), "rb")
    try:
        with _named(path):
            status = os.fstat(stream.fileno())
            _refuse_irregular(path, status.st_mode)  # another file may have got the name; no pipe waits, by O_NONBLOCK
            if kind.most_bytes and status.st_size > kind.most_bytes:
                raise _too_large(path, status.st_size, kind)
            _refuse_format(path, start := stream.read(_LONGEST_START), kind)
            if kind.most_text_bytes and start.lstrip(_SPACE)[:1] in (b"{", b"<", b"["):
                _refuse_large_text(path, status.st_size, kind)
            if kind.most_bytes and start.startswith(_ZIP):
                _refuse_full_archive(path, stream, kind)
            stream.seek(0)
    except BaseException:
        stream.close()
        raise
    return stream


def read_input(path: Path, kind: InputKind) -> bytes:
    """The bytes of a file whose kind has a size limit.

    Raises
    ------
    UnusableFileError : see ``open_input``; also a file that grows beyond the limit while it is read.
    """
    with open_input(path, kind) as stream, _named(path):
        content = stream.read(kind.most_bytes + 1)
    if len(content) > kind.most_bytes:
        raise _too_large(path, len(content), kind)
    return content


def check_input(path: Path, kind: InputKind) -> None:
    """Raise UnusableFileError for what ``open_input`` refuses; for readers that take a name."""
    open_input(path, kind).close()


def is_geodatabase(path: Path) -> bool:
    """Whether it is a folder named as a file geodatabase."""
    return path.suffix.lower() == ".gdb" and path.is_dir()


def parts_of(path: Path) -> list[Path]:
    """The file, or the files of a file geodatabase, in their order.

    Raises
    ------
    UnusableFileError : a geodatabase with folders in it, or with more files than one has.
    """
    if not is_geodatabase(path):
        return [path]
    with _named(path), os.scandir(path) as entries:
        found = []
        for entry in entries:
            found.append(path / entry.name)
            if not entry.is_file() or len(found) > _MAX_FOLDER_FILES:
                raise UnusableFileError(f"{_name(path)} is no file geodatabase; give the file itself.")
    if not any(p.suffix.lower() == ".gdbtable" for p in found):
        raise UnusableFileError(f"{_name(path)} is no file geodatabase; give the file itself.")
    return sorted(found)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """What the system says of the file as a sentence."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MissingFileError(f"{_name(path)} does not exist; check its path.") from error
    except ValueError as error:  # a zero byte in the name
        raise MissingFileError(f"{_name(path)} does not exist; check its path.") from error
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise UnusableFileError(f"{_name(path)} is a link that leads back to itself; give the file.") from error
        raise UnusableFileError(f"{_name(path)} cannot be read ({error.strerror}); check its permissions.") from error


def _refuse_irregular(path: Path, mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise UnusableFileError(f"{_name(path)} is a folder; give the file inside it.")
    if not stat.S_ISREG(mode):
        raise UnusableFileError(f"{_name(path)} is not a regular file but a pipe or a device; save it as a file.")


def _refuse_format(path: Path, start: bytes, kind: InputKind) -> None:
    if kind.starts and not start:
        raise UnusableFileError(f"{_name(path)} is empty (0 bytes); copy or export it again.")
    text = start.lstrip(_SPACE)
    known = not kind.starts or start.startswith(kind.starts)
    if not known or (kind.refused and (start.startswith(kind.refused) or text.startswith(kind.refused))):
        raise UnusableFileError(f"{_name(path)} is not {kind.formats}; give one.")


def _refuse_large_text(path: Path, size: int, kind: InputKind) -> None:
    if size > kind.most_text_bytes:
        raise UnusableFileError(
            f"{_name(path)} has {size / _MB:,.1f} MB of text, and at most {kind.most_text_bytes / _MB:,.3g} MB are "
            "read; save it as a GeoPackage."
        )


def _refuse_full_archive(path: Path, stream: BinaryIO, kind: InputKind) -> None:
    try:
        with zipfile.ZipFile(stream) as archive:
            sizes = [entry.file_size for entry in archive.infolist()]
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise UnusableFileError(f"{_name(path)} is a damaged archive; copy or export it again.") from error
    if sum(sizes) > kind.most_bytes or len(sizes) > _MAX_FOLDER_FILES:
        raise _too_large(path, sum(sizes), kind)


def _too_large(path: Path, size: int, kind: InputKind) -> UnusableFileError:
    return UnusableFileError(
        f"{_name(path)} has {size / _MB:,.1f} MB, and at most {kind.most_bytes / _MB:,.3g} MB are read; check that it "
        "is the right file."
    )


def _name(path: Path) -> str:
    """As messages name files: in quotes and one line."""
    text = str(path)[:_SHOWN]
    return "'" + "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text) + "'"

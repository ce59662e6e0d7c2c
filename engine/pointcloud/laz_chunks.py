"""Structure of the compressed points of a LAZ file, checked in Python before the decompressor runs.

A decompressor takes the sizes in the file at their word and allocates by them. Every size is therefore checked here
against the file: the LASzip record, the place and length of the chunk table and, for the layered chunks of point
formats 6 to 10, the number of points and the sizes of the layers in each chunk.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO

from ..core.errors import InputError

_ITEM_SIZES = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
_ITEMS_OF_FORMAT = {
    0: (6,),
    1: (6, 7),
    2: (6, 8),
    3: (6, 7, 8),
    4: (6, 7, 9),
    5: (6, 7, 8, 9),
    6: (10,),
    7: (10, 11),
    8: (10, 12),
    9: (10, 13),
    10: (10, 12, 13),
}
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_BYTES, _LAYERED_BYTES = 0, 14
_VARIABLE = 2**32 - 1
_MAXIMUM_CHUNK = 1 << 30
"""Most bytes that one chunk may decompress to; LASzip's own chunks of 50,000 points stay below 5 MB."""


@dataclass(frozen=True)
class PointBlock:
    """Where a file's compressed points are by its header: ``count`` records from byte ``offset`` of ``size`` on.

    ``name`` is the file's in messages.
    """

    name: str
    point_format: int
    record_length: int
    count: int
    offset: int
    size: int


@dataclass(frozen=True)
class LazLayout:
    """The LASzip record and where the chunks lie.

    ``table_offset`` is the first byte of the chunk table, ``chunk_size`` the points of a chunk (0: variable, each entry
    of the table says), ``layers`` the number of layers in a chunk (0: the points of a chunk follow each other).
    """

    block: PointBlock
    record: bytes
    chunk_size: int
    table_offset: int
    layers: int


def laz_layout(stream: BinaryIO, block: PointBlock, record: bytes | None) -> LazLayout:
    """Check the LASzip record and the place of the chunk table.

    Raises:
        InputError: the record is missing or contradicts the header, or the chunk table is not inside the file.
    """
    name, count, offset, size = block.name, block.count, block.offset, block.size
    if record is None or len(record) < 34:
        raise InputError(f"{name} is compressed but has no LASzip record; compress it again with a current program.")
    compressor, coder, _, _, _, _, chunk_size, _, _, items = struct.unpack_from("<HHBBHIIqqH", record, 0)
    if compressor not in (2, 3) or coder != 0:
        raise InputError(
            f"{name} is compressed in a way that is unknown (LASzip compressor {compressor}); compress it again with "
            "a current program."
        )
    layers = _check_items(block, record, items, compressor)
    if offset + 8 > size:
        raise InputError(f"{name} is cut short before its first point; copy it again.")
    stream.seek(offset)
    table: int = struct.unpack("<q", stream.read(8))[0]
    if table == -1:  # a writer that could not seek back leaves the offset in the last eight bytes
        stream.seek(size - 8)
        table = struct.unpack("<q", stream.read(8))[0]
    if not offset + 8 <= table <= size - 8:
        raise InputError(
            f"{name} has no table of its compressed chunks inside the file ({size} bytes); it is cut short or damaged, "
            "so copy it again."
        )
    stream.seek(table)
    version, chunks = struct.unpack("<II", stream.read(8))
    variable = chunk_size == _VARIABLE
    expected = chunks if variable else -(-count // max(chunk_size, 1))
    if version != 0 or chunk_size == 0 or chunks != expected or chunks * block.record_length > table - offset:
        raise InputError(
            f"{name} has a table of {chunks} compressed chunks that does not fit its {count} points; it is damaged or "
            "cut short, so copy it again."
        )
    if not variable and min(chunk_size, count) * block.record_length > _MAXIMUM_CHUNK:
        raise InputError(
            f"{name} is compressed in chunks of {chunk_size} points; compress it again in chunks of 50000."
        )
    return LazLayout(block, record, 0 if variable else chunk_size, table, layers)


def check_chunks(stream: BinaryIO, layout: LazLayout, chunks: list[tuple[int, int]]) -> str | None:
    """Check the chunk table's entries (points, bytes) against the file and, where chunks are layered, their layers.

    Returns:
        A warning if the last chunk holds more points than the header says, else None.

    Raises:
        InputError: an entry or a layer that cannot be true, or fewer points than the header says.
    """
    name, count, offset = layout.block.name, layout.block.count, layout.block.offset
    record_length = layout.block.record_length
    damaged = InputError(f"{name} is damaged inside its compressed points; copy it again from its source.")
    if (
        sum(points for points, _ in chunks) != count
        or sum(size for _, size in chunks) != layout.table_offset - offset - 8
    ):
        raise damaged
    position, surplus = offset + 8, 0
    for index, (points, size) in enumerate(chunks):
        if not 0 < points * record_length <= _MAXIMUM_CHUNK or size < record_length:
            raise damaged
        if layout.layers:
            # A layered chunk: the first point as it is, the number of points, the size of each layer, the layers.
            stream.seek(position + record_length)
            head = stream.read(4 + 4 * layout.layers)
            if len(head) < 4 + 4 * layout.layers:
                raise damaged
            held, *sizes = struct.unpack(f"<{1 + layout.layers}I", head)
            if record_length + len(head) + sum(sizes) != size:
                raise damaged
            surplus = held - points
            last = index == len(chunks) - 1 and layout.chunk_size
            if surplus and not (last and held <= layout.chunk_size):
                raise damaged
        position += size
    if surplus < 0:
        raise InputError(
            f"{name} holds {count + surplus} of the {count} points that its header says; copy or export it again."
        )
    if surplus:
        return f"{name} holds {count + surplus} points but its header says {count}; the last {surplus} are left out."
    return None


def _check_items(block: PointBlock, record: bytes, items: int, compressor: int) -> int:
    """Check the LASzip record's items against the point format; the number of layers of a chunk (0: not layered)."""
    if len(record) < 34 + 6 * items or items > 16:
        raise InputError(f"{block.name} has a LASzip record that is cut short; copy it again.")
    kinds = [struct.unpack_from("<HHH", record, 34 + 6 * index) for index in range(items)]
    standard = _ITEMS_OF_FORMAT[block.point_format]
    extra = kinds[len(standard) :]
    sound = (
        tuple(kind for kind, _, _ in kinds[: len(standard)]) == standard
        and all(size == _ITEM_SIZES[kind] for kind, size, _ in kinds[: len(standard)])
        and (not extra or (len(extra) == 1 and extra[0][0] in (_BYTES, _LAYERED_BYTES)))
        and sum(size for _, size, _ in kinds) == block.record_length
    )
    if not sound:
        raise InputError(f"{block.name} has a LASzip record that contradicts its header; copy or export it again.")
    if compressor != 3:
        return 0
    return sum(size if kind == _LAYERED_BYTES else _LAYERS.get(kind, 0) for kind, size, _ in kinds)

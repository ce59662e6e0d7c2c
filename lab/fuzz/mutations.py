"""Files changed as damage, other programs and attackers change them: bytes, JSON, cells of CSV, tables of SQLite.

Each function takes the sound file's bytes and a ``random.Random``; the same seed gives the same changed bytes.
"""

from __future__ import annotations

import copy
import json
import random
import sqlite3
import struct
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

Mutation = Callable[[bytes, random.Random], bytes]

NASTY: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 0.5, -0.0, 1e-320, 1e308, -1e308, 10**18, 10**400, float("nan"), float("inf"),
    float("-inf"), "", "x", "0", "nan", "2024-05-01", "2024-13-45", "0000-01-01", "9999-12-31", "../../etc/passwd",
    "/etc/passwd", "<script>alert(1)</script>", "=1+1", "\ud800", "\x00", "é" * 300, "a\nb", "$x^$", "{{ 7*7 }}",
    [], [None], [0, 0], [[]], [1e308] * 3, {}, {"a": None}, {"": 1}, {"x": {"y": []}},
)  # fmt: skip
"""What stands where something else was expected."""
NASTY_CELLS = (
    "", " ", "-1", "0", "1e400", "nan", "inf", "-inf", "1e308", "x", "=1+1", "0000-01-01", "0001-W01-1", "0001-01-01",
    "9999-12-31", "2024-W18", "20240501", "2024-02-30", "99999-01-01", "é", "\x00", "\ufeff", '"', "a\nb", "../..",
    "/dev/zero", "/", ".", "a" * 70000, "١٢", "#12345", "#GGGGGG", "1_000", "0x10", "१", "\ud83d", "<b>", "٢٠٢٤-٠٥-٠١",
)  # fmt: skip


def changed_bytes(data: bytes, rng: random.Random) -> bytes:
    """Bits turned, bytes overwritten, parts cut, doubled or moved; mostly near the start, where a file's header is."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        size = len(result)
        if not size:
            break
        place = (
            min(rng.randrange(size), rng.randrange(size), rng.randrange(size))
            if rng.random() < 0.6
            else rng.randrange(size)
        )
        kind = rng.randrange(8)
        if kind <= 1:
            result[place] ^= 1 << rng.randrange(8)
        elif kind == 2:
            result[place] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
        elif kind == 3:
            layout = rng.choice(["<H", "<I", "<Q", "<d", ">H", ">I"])
            numbers = (0, 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1)
            value: Any = (
                rng.choice((0.0, float("nan"), float("inf"), 1e300, -1.0)) if layout == "<d" else rng.choice(numbers)
            )
            packed = struct.pack(layout, value if layout == "<d" else value % 2 ** (8 * struct.calcsize(layout)))
            result[place : place + len(packed)] = packed
        elif kind == 4:
            del result[place:]
        elif kind == 5:
            del result[place : place + rng.choice((1, 2, 8, 100))]
        elif kind == 6:
            result[place:place] = result[place : place + rng.choice((1, 4, 64))]
        else:
            length = rng.choice((1, 4, 32))
            result[place : place + length] = rng.randbytes(length)
    return bytes(result)


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    found = [path] if path else []
    if isinstance(value, dict):
        for key in value:
            found += _places(value[key], (*path, key))
    elif isinstance(value, list):
        # of a long list only the ends and one between: else nothing but its numbers would ever be changed
        for index in sorted({0, len(value) // 2, len(value) - 1} & set(range(len(value)))):
            found += _places(value[index], (*path, index))
    return found


def changed_value(document: Any, rng: random.Random) -> Any:
    """A copy of a JSON document in which one value or key is another, is gone, or is there twice."""
    document = copy.deepcopy(document)
    path = rng.choice(_places(document) or [()])
    if not path:
        return rng.choice(NASTY)
    parent = document
    for key in path[:-1]:
        parent = parent[key]
    key, old = path[-1], parent[path[-1]]
    kind = rng.randrange(10)
    if kind == 0:
        del parent[key]
    elif kind == 1 and isinstance(parent, dict):
        parent[rng.choice(("", "x", "0", "zone_id", str(key).upper()))] = parent.pop(key)
    elif kind == 2 and isinstance(old, (int, float)) and not isinstance(old, bool) and abs(old) < 1e300:
        parent[key] = rng.choice((-old, old * 1e30, old * 1e-30, old + 1, str(old), [old], float(old), 10**9))
    elif kind == 3 and isinstance(old, (list, str)):
        parent[key] = rng.choice(
            (old[:0], old[:1], old[1:], old + old, old[::-1], old * 1000 if len(old) < 200 else old)
        )
    elif kind == 4 and isinstance(old, str):
        parent[key] = rng.choice(NASTY_CELLS) + rng.choice(("", old))
    elif kind == 5:
        other = document
        for step in rng.choice(_places(document)):
            other = other[step]
        parent[key] = copy.deepcopy(other)
    else:
        parent[key] = rng.choice(NASTY)
    return document


def changed_json(data: bytes, rng: random.Random) -> bytes:
    """A changed value, sometimes two; or text that is no JSON, in rare cases."""
    kind = rng.randrange(40)
    if kind == 0:
        return changed_bytes(data, rng)
    if kind == 1:
        return b"[" * 200_000
    if kind == 2:
        return b'{"a":' * 100_000 + b"1" + b"}" * 100_000
    if kind == 3:
        return data[:-2].rstrip() + b', "x": ' + b"9" * 5000 + b"}"
    if kind == 4:
        return data.decode("utf-8").encode("utf-16")
    document = json.loads(data)
    for _ in range(1 if rng.random() < 0.8 else 3):
        document = changed_value(document, rng)
    return json.dumps(document, ensure_ascii=rng.random() < 0.5).encode("utf-8", "surrogatepass")


def changed_table(data: bytes, rng: random.Random) -> bytes:
    """A cell of a CSV file changed, a line or column gone or doubled; sometimes its bytes."""
    if rng.random() < 0.15:
        return changed_bytes(data, rng)
    rows = [line.split(",") for line in data.decode("utf-8").splitlines()]
    row = rng.randrange(len(rows))
    column = rng.randrange(len(rows[row]))
    kind = rng.randrange(9)
    if kind == 0:
        del rows[row]
    elif kind == 1:
        rows.insert(row, list(rows[row]))
    elif kind == 2:
        del rows[row][column]
    elif kind == 3:
        rows[row].insert(column, rng.choice(NASTY_CELLS))
    elif kind == 4:
        rows = [r[:column] + r[column + 1 :] for r in rows]
    elif kind == 5:
        rng.shuffle(rows)
    else:
        rows[row][column] = rng.choice(NASTY_CELLS)
    text = rng.choice("\n\n\n\r").join(rng.choice(",,,,,;").join(r) for r in rows)
    return text.encode("utf-8", "surrogatepass")


def changed_database(data: bytes, rng: random.Random) -> bytes:
    """A GeoPackage with a value of one of its tables changed, a table gone, a geometry damaged; sometimes its bytes."""
    if rng.random() < 0.3:
        return changed_bytes(data, rng)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.gpkg")
        path.write_bytes(data)
        try:
            with closing(sqlite3.connect(path)) as base, base:
                names = "SELECT name, type FROM sqlite_master WHERE type IN ('table', 'trigger')"
                tables = base.execute(names).fetchall()
                for name, kind in tables:
                    if kind == "trigger":
                        base.execute(f'DROP TRIGGER "{name}"')
                table = rng.choice(
                    [name for name, kind in tables if kind == "table" and not name.startswith(("rtree", "sqlite"))]
                )
                if rng.random() < 0.1:
                    base.execute(f'DROP TABLE "{table}"')
                else:
                    _change_column(base, table, rng)
        except sqlite3.Error:
            return changed_bytes(data, rng)
        return path.read_bytes()


def _change_column(base: sqlite3.Connection, table: str, rng: random.Random) -> None:
    columns = base.execute(f'PRAGMA table_info("{table}")').fetchall()
    column = rng.choice(columns)[1]
    rows = base.execute(f'SELECT rowid, "{column}" FROM "{table}" ORDER BY rowid').fetchall()
    if not rows:
        return
    number, old = rng.choice(rows)
    if isinstance(old, bytes):
        new: Any = changed_bytes(old, rng)
    else:
        numbers = (None, "", "x", -1, 0, 2**62, 1e308, "<script>", "=1+1", b"\x00\xff", "a" * 100_000, -1e308, 32651)
        new = rng.choice(numbers)
    if rng.random() < 0.1:
        base.execute(f'DELETE FROM "{table}" WHERE rowid = ?', (number,))
    else:
        base.execute(f'UPDATE "{table}" SET "{column}" = ? WHERE rowid = ?', (new, number))


def changed_tags(data: bytes, rng: random.Random) -> bytes:
    """A TIFF with the kind, count or value of one entry of its first directory changed; sometimes its bytes."""
    if rng.random() < 0.4 or data[:4] != b"II*\x00":
        return changed_bytes(data, rng)
    result = bytearray(data)
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    entry = start + 2 + 12 * rng.randrange(count)
    numbers = (0, 1, 2, 3, 7, 255, 65535, 2**31 - 1, 2**32 - 1, 100_000, 300_000)
    kind = rng.randrange(4)
    if kind == 0:
        struct.pack_into("<H", result, entry + 2, rng.randrange(20))
    elif kind == 1:
        struct.pack_into("<I", result, entry + 4, rng.choice(numbers))
    elif kind == 2:
        struct.pack_into("<I", result, entry + 8, rng.choice(numbers))
    else:
        struct.pack_into("<H", result, entry, rng.randrange(65536))
    return bytes(result)


def changed_safetensors(data: bytes, rng: random.Random) -> bytes:
    """Weights whose header (JSON) or numbers are others, with the header's length put right or not."""
    (length,) = struct.unpack_from("<Q", data)
    header, numbers = data[8 : 8 + length], data[8 + length :]
    kind = rng.randrange(4)
    if kind == 0:
        return changed_bytes(data, rng)
    if kind == 1:
        place = 4 * rng.randrange(len(numbers) // 4)
        value = rng.choice((float("nan"), float("inf"), 3e38, -3e38, 0.0, -1.0))
        return data[: 8 + length + place] + struct.pack("<f", value) + numbers[place + 4 :]
    if kind == 2:
        value = struct.pack("<f", rng.choice((float("nan"), float("-inf"), 3e38, -1.0)))
        return data[: 8 + length] + value * (len(numbers) // 4) + numbers[len(numbers) // 4 * 4 :]
    changed = changed_json(header, rng)
    return struct.pack("<Q", len(changed)) + changed + numbers

"""Mapping files as people write them, and what is wrong with one in one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector.field_mapping import read_field_mapping

_WANTED = {"zone_id": "ASSET", "zones.kind": "Bewegungsart ü"}


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(_WANTED),
        json.dumps(_WANTED, ensure_ascii=False, indent=3),
        "our,theirs\nzone_id,ASSET\nzones.kind,Bewegungsart ü\n",
        "\ufeffOur, Theirs\r\n zone_id , ASSET \r\n\r\nzones.kind,Bewegungsart ü",
        'our,theirs\nzone_id,"ASSET"\nzones.kind,Bewegungsart ü\n',
    ],
)
def test_json_and_csv_say_the_same(text: str, tmp_path: Path) -> None:
    (tmp_path / "names").write_bytes(text.encode())
    assert read_field_mapping(tmp_path / "names") == _WANTED


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "does not begin with the columns our,theirs"),
        (b"zone_id,ASSET\n", "does not begin with the columns our,theirs"),
        (b"our,theirs\n", "names no field"),
        (b"our,theirs\na,b,c\n", r"a row of other than two columns \(row 2\)"),
        (b"our,theirs\na,\n", "an empty name next to 'a'"),
        (b"our,theirs\na,b\na,c\n", "names the field 'a' twice"),
        (b"our,theirs\na,GEOM\n", "has the name GEOM, which tables keep for themselves"),
        (b"our,theirs\na," + 64 * b"x" + b"\n", "of at most 63 characters"),
        (b'our,theirs\na,"x""y"\n', "without quotes"),
        (b'our,theirs\na,"x\n', "is no CSV file"),
        (b"our,theirs\na,\xff\n", "is no text in UTF-8"),
        (b'{"a": 3}', "a name that is no text"),
        (b'{"a": "b"', "is no JSON object of names"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "names.csv"
    path.write_bytes(text)
    with pytest.raises(InputError, match=words) as caught:
        read_field_mapping(path)
    assert str(path) in str(caught.value)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_field_mapping(tmp_path / "none.csv")

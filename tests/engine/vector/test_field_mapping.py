"""An agency's names of fields, from JSON and from CSV."""

from __future__ import annotations

from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.vector.field_mapping import FieldMapping, read_field_mapping


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_json_and_csv_say_the_same(tmp_path: Path) -> None:
    of_json = read_field_mapping(
        written(
            tmp_path / "a.json", '{"route": "ROAD_NO", "zones": {"chain_from": "START"}, "centreline": {"route": "R"}}'
        )
    )
    of_csv = read_field_mapping(
        written(tmp_path / "a.csv", "﻿table,Ours,THEIRS\n,route,ROAD_NO\nzones,chain_from,START\ncentreline,route,R\n")
    )
    assert of_json.names == of_csv.names
    for names in (of_json, of_csv):
        assert [names.theirs("route", t) for t in ("", "zones", "centreline")] == ["ROAD_NO", "ROAD_NO", "R"]
        assert [names.theirs("chain_from", t) for t in ("", "zones")] == ["chain_from", "START"]
        assert names.renamed(["route", "chain_from", "side"], "zones") == {
            "route": "ROAD_NO", "chain_from": "START", "side": "side",
        }  # fmt: skip
    assert read_field_mapping(None) == FieldMapping()
    assert FieldMapping().theirs("route") == "route"


def test_a_table_may_stand_before_the_name(tmp_path: Path) -> None:
    names = read_field_mapping(written(tmp_path / "a.json", '{"route": "ROAD", "zones.kind": "Bewegungsart ü"}'))
    assert names.theirs("kind", "zones") == "Bewegungsart ü"
    assert names.theirs("kind", "events") == "kind"
    assert names.flat == {"route": "ROAD", "zones.kind": "Bewegungsart ü"}


def test_two_fields_of_one_name_are_refused() -> None:
    names = FieldMapping({"": {"route": "Side"}})
    with pytest.raises(InputError, match="give route and side the one name side"):
        names.renamed(["route", "side"])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.json", "[1]", "are no object of names"), ("a.json", "{", "are no JSON"), ("a.json", "{}", "hold no name"),
        ("a.json", '{"route": 3}', "have 3 for 'route'"), ("a.json", '{"route": " "}', "have ' ' for 'route'"),
        ("a.json", '{"route": "FID"}', "which layers keep for themselves"),
        ("a.csv", "ours,theirs\nroute," + 64 * "x" + "\n", "of at most 63 characters"),
        ("a.csv", 'ours,theirs\nroute,"x""y"\n', "without quotes"),
        ("a.csv", "a,b\n1,2\n", "have no columns ours"),
        ("a.csv", "ours,theirs\nroute,A\nroute,B\n", "give route two names, A and B"),
        ("a.csv", "ours,theirs\n", "hold no"),
    ],
)  # fmt: skip
def test_what_is_no_mapping_is_named(tmp_path: Path, name: str, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_field_mapping(written(tmp_path / name, text))
    assert words in str(caught.value)
    assert str(caught.value).endswith(".")
    assert name in str(caught.value)


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_field_mapping(tmp_path / "gone.json")
    (tmp_path / "b.csv").write_bytes(b"ours,theirs\nroute,\xff\xfe\n")
    with pytest.raises(InputError, match="no text in UTF-8"):
        read_field_mapping(tmp_path / "b.csv")

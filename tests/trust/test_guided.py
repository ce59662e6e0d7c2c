"""The guided fuzzer keeps what stopped it, however it ends; with a stand-in for atheris, which few systems have."""

from __future__ import annotations

import contextlib
import importlib
import json
import random
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from slopewatch.lab.fuzz import mutations


class Atheris:
    """Calls the fuzzed function once with what a test gives, and changes it by the custom mutator first."""

    def __init__(self) -> None:
        self.data, self.arguments, self.kept = b"", [], SimpleNamespace()

    @contextlib.contextmanager
    def instrument_imports(self, include: list[str]) -> Iterator[None]:
        yield

    def Mutate(self, data: bytes, size: int) -> bytes:
        return data[:size]

    def Setup(self, arguments: list[str], one: Callable[[bytes], None], custom_mutator: Any) -> None:
        self.arguments, self.one, self.custom = arguments, one, custom_mutator

    def Fuzz(self) -> None:
        self.one(self.data)


@pytest.fixture
def guided(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[ModuleType, Atheris]]:
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    stand_in = Atheris()
    monkeypatch.setitem(sys.modules, "atheris", stand_in)
    sys.modules.pop("slopewatch.lab.fuzz.guided", None)
    yield importlib.import_module("slopewatch.lab.fuzz.guided"), stand_in
    sys.modules.pop("slopewatch.lab.fuzz.guided", None)


def begun(module: ModuleType, folder: Path, name: str = "transform.json") -> Path:
    kept, scratch = folder / "kept", folder / "scratch"
    kept.mkdir()
    scratch.mkdir()
    module.fuzz(name, kept, scratch)
    return kept


def test_what_is_read_lies_on_the_disk_before(guided: tuple[ModuleType, Atheris], tmp_path: Path) -> None:
    module, atheris = guided
    atheris.data = b"[1, 2"
    kept = begun(module, tmp_path)
    assert (kept / "last-transform.json").read_bytes() == b"[1, 2"
    assert f"-artifact_prefix={kept}/" in atheris.arguments
    # and it can be repeated
    assert "last-transform.json" not in module.repeat("transform.json", kept / "last-transform.json")
    assert "transform.json" in module.repeat("transform.json", kept / "last-transform.json")


def test_a_stop_leaves_the_file_that_was_being_read(
    guided: tuple[ModuleType, Atheris], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, atheris = guided
    atheris.data = b"{}"

    def stop(name: str, path: Path) -> str:
        raise KeyboardInterrupt(path.name)

    monkeypatch.setattr(module.readers, "refusal", stop)
    with pytest.raises(KeyboardInterrupt, match="last-points"):
        begun(module, tmp_path, "points.json")
    assert (tmp_path / "kept" / "last-points.json").read_bytes() == b"{}"
    monkeypatch.undo()


def test_a_fault_of_the_changes_is_kept_and_ends_nothing(
    guided: tuple[ModuleType, Atheris], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, atheris = guided
    sound, given = {"length": 0}, []

    def change(data: bytes, rng: random.Random) -> bytes:
        given.append(data)
        if data == b"odd":
            raise OverflowError("too large")
        sound["length"] = len(data)
        return data

    reader = module.readers.READERS["transform.json"][0]
    monkeypatch.setitem(module.readers.READERS, "transform.json", (reader, change))
    atheris.data = b"{}"
    kept = begun(module, tmp_path)
    results = {len(atheris.custom(b"odd", 10_000, seed)) for seed in range(30)}
    assert results == {len(b"odd"), sound["length"]}, "left as it was, or made of the sound file"
    (file,) = (p for p in kept.glob("mutator-*") if p.suffix != ".txt")
    assert file.read_bytes() == b"odd"
    assert "too large" in file.with_suffix(".txt").read_text()


def test_the_same_seed_makes_the_same_changes(tmp_path: Path) -> None:
    """Of tables of SQLite too, whose own random order is another one every time."""
    geopandas, shapely = pytest.importorskip("geopandas"), pytest.importorskip("shapely")
    path = tmp_path / "a.gpkg"
    shapes = [shapely.box(n, 0, n + 1, 1) for n in range(40)]
    geopandas.GeoDataFrame({"a": range(40)}, geometry=shapes, crs=32651).to_file(path)
    data = path.read_bytes()
    document = json.dumps({"a": [1, 2, {"b": "c"}]}).encode()
    for seed in range(12):
        for change, sound in ((mutations.changed_database, data), (mutations.changed_json, document)):
            assert change(sound, random.Random(seed)) == change(sound, random.Random(seed)), (seed, change)

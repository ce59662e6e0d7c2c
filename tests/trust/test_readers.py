"""Changed files of every kind, read within this process: taken, or refused in one sentence. ``make fuzz`` does more."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from slopewatch.lab.fuzz.readers import READERS, refusal, sound_files


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    folder = tmp_path_factory.mktemp("sound")
    return folder, sound_files(folder)


@pytest.mark.parametrize("name", READERS)
def test_the_sound_file_is_taken(sound: tuple[Path, dict[str, bytes]], name: str) -> None:
    folder, files = sound
    path = folder / name
    path.write_bytes(files[name])
    assert refusal(name, path) == ""


@pytest.mark.parametrize("name", READERS)
def test_a_changed_file_is_taken_or_refused(sound: tuple[Path, dict[str, bytes]], name: str) -> None:
    folder, files = sound
    change, refused = READERS[name][1], []

    @settings(max_examples=150, deadline=5000, derandomize=True, suppress_health_check=list(HealthCheck), database=None)
    @given(seed=st.integers(0, 2**32))
    def look(seed: int) -> None:
        path = folder / name
        path.write_bytes(change(files[name], random.Random(seed)))
        refused.append(bool(refusal(name, path)))

    look()
    (folder / name).write_bytes(files[name])
    assert sum(refused) > 20, "the changes are too small to be found"
    assert not all(refused), "and too large to leave a sound file"

"""Small clouds to be damaged, and the sentence with which one is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import InputParameters

UTM = InputParameters(crs="EPSG:32651")


def refused(path: Path, *words: str) -> str:
    """The one sentence with which the cloud is refused; it names the file and holds ``words``."""
    with pytest.raises(InputError) as caught:
        read_cloud(path, UTM)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert path.name in sentence
    assert sentence.endswith(".")
    for word in words:
        assert word in sentence, sentence
    return sentence


def patched(path: Path, place: int, layout: str, *values: object) -> Path:
    data = bytearray(path.read_bytes())
    struct.pack_into("<" + layout, data, place, *values)
    path.write_bytes(data)
    return path


@pytest.fixture
def las(tmp_path, las_file) -> Path:
    return las_file(tmp_path / "a.las")


@pytest.fixture
def laz(tmp_path, las_file) -> Path:
    return las_file(tmp_path / "a.laz", points=60_000)

"""The Python examples of the documents run as they stand there, in a folder with the files that they name."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import geopandas as gpd
import pytest
import shapely
from slopewatch.tests.builders.planes import write_plane

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = [
    pytest.param(block, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, block in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M))
]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A slope before and after a block of 3 x 3 m rose by 0.3 m, under the names that the documents use."""
    folder = tmp_path_factory.mktemp("files")
    first = write_plane(folder / "first.laz", seed=1)
    later = write_plane(folder / "later.laz", seed=2, raised=(8.0, 8.0, 3.0, 0.3))
    outline = folder / "outline.gpkg"
    slope = shapely.box(500_000, 3_500_000, 500_020, 3_500_020)
    gpd.GeoDataFrame(geometry=[slope], crs="EPSG:32651").to_file(outline)
    earlier = ("may24.laz", "may24_ground.laz", "2024-05-01.laz")
    return dict.fromkeys(earlier, first) | {
        "may25.laz": later,
        "may25_ground.laz": later,
        "2025-05-01.laz": later,
        "slope.gpkg": outline,
    }


def test_there_are_examples() -> None:
    assert len(EXAMPLES) >= 3


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_example_runs(
    example: str, files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, file in files.items():
        (tmp_path / name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    done = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout

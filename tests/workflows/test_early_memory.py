"""What cannot fit into the memory is refused before any ground is extracted, with a cell that then runs."""

from __future__ import annotations

import re
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
import shapely
from pyproj import CRS
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.epochs.epoch import Epoch
from slopewatch.interface.dates import date_in_name
from slopewatch.interface.parameters import ChangeParameters, InputParameters, SurfaceParameters
from slopewatch.workflows.change import change_step
from slopewatch.workflows.early_memory import refuse_grid_early
from slopewatch.workflows.inspect import inspect_slope
from slopewatch.workflows.settings import Settings

SIDE = 120.0


def write_slope(path: Path, *, stray: bool = False) -> Path:
    rng = np.random.default_rng([*path.name.encode()])
    u, v = rng.uniform(0, SIDE, (2, 30_000))
    if stray:
        u[0] += 50_000
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.001] * 3, [500_000, 3_500_000, 0]
    header.add_crs(CRS.from_epsg(32651))
    las = laspy.LasData(header)
    las.x, las.y, las.z = 500_000 + u, 3_500_000 + v, 100 + 0.5 * v + rng.normal(0, 0.02, u.size)
    las.return_number = las.number_of_returns = np.ones(u.size, dtype=np.uint8)
    las.write(path)
    return path


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("clouds")
    return [write_slope(folder / f"{year}-05-01.laz") for year in (2024, 2025)]


def early(clouds: list[Path], roi: Path | None = None, **values: float) -> None:
    refuse_grid_early(clouds, InputParameters(), ChangeParameters(**values), roi)


def test_the_cell_that_is_named_is_not_refused(clouds: list[Path]) -> None:
    with pytest.raises(InputError, match="cell of at least") as refusal:
        early(clouds, cell=0.05, memory_limit=0.1)
    found = re.search(r"at least ([\d.]+) m", str(refusal.value))
    assert found
    early(clouds, cell=float(found[1]), memory_limit=0.1)
    early(clouds, cell=0.05, memory_limit=4.0)
    early(clouds, memory_limit=0.05)  # left to the clouds: as large as it must be


def test_the_region_of_interest_counts(clouds: list[Path], tmp_path: Path) -> None:
    area = shapely.box(500_010, 3_500_010, 500_030, 3_500_030)
    roi = tmp_path / "roi.gpkg"
    geopandas.GeoDataFrame(geometry=[area], crs=32651).to_file(roi)
    early(clouds, roi, cell=0.05, memory_limit=0.2)
    with pytest.raises(InputError, match="GB allowed"):
        early(clouds, roi, cell=0.02, memory_limit=0.2)


def test_stray_points_far_away_are_left_to_the_extraction(tmp_path: Path) -> None:
    cloud = write_slope(tmp_path / "2024-05-01.laz", stray=True)
    early([cloud, cloud], cell=0.1, memory_limit=1.0)


def test_the_whole_flow_refuses_before_it_extracts(
    clouds: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("ground was extracted")

    monkeypatch.setattr("slopewatch.workflows.inspect.extract_ground", never)
    settings = Settings(change=ChangeParameters(cell=0.02, memory_limit=0.1))
    epochs = [Epoch(path, date_in_name(path)) for path in clouds]
    with pytest.raises(InputError, match=r"more than the 0\.1 GB allowed"):
        inspect_slope(epochs, tmp_path / "out", settings)
    assert not list((tmp_path / "out").glob("*"))


def test_a_change_is_refused_before_the_clouds_are_read(
    clouds: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("a cloud was read")

    monkeypatch.setattr("slopewatch.workflows.change.read_cloud", never)
    settings = Settings(surface=SurfaceParameters(ground="as_is"), change=ChangeParameters(cell=0.02, memory_limit=0.1))
    with pytest.raises(InputError, match=r"more than the 0\.1 GB allowed"):
        change_step(*clouds, tmp_path / "out", settings, dates=(None, None), transform_path=None, progress=Progress())
    assert not list((tmp_path / "out").glob("*"))


def test_half_of_the_machines_memory_is_allowed_unless_a_limit_is_given(
    clouds: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("slopewatch.engine.grid.common_grid.machine_memory", lambda: 400_000_000)
    with pytest.raises(InputError, match=r"more than the 0\.2 GB allowed"):
        early(clouds, cell=0.05)
    early(clouds, cell=0.3)
    early(clouds, cell=0.05, memory_limit=4.0)

"""Ids of tasks, hashes that are kept, settings on the command line, and the memory that a slope should need."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from datetime import date
from pathlib import Path

import click.testing
import geopandas
import numpy as np
import pytest
from shapely import box
from slopewatch.cli.program import cli
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.machine_memory import machine_memory
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.displacement.displacement import measure_displacement
from slopewatch.engine.displacement.registered import Registered
from slopewatch.engine.grid.common_grid import memory_needed
from slopewatch.interface.parameters import BatchParameters, ChangeParameters, DisplacementParameters
from slopewatch.tests.builders.clouds import LasFile, las_file
from slopewatch.tests.builders.rough_ground import relief, sampled
from slopewatch.workflows.batch.estimate import default_budget, motion_memory, slope_memory
from slopewatch.workflows.batch.jobs import Job, Slope, Survey
from slopewatch.workflows.batch.planning import Common, plan
from slopewatch.workflows.batch.settings import (
    arguments_of,
    command_of,
    effective,
    group_of,
    options_of,
    specifications,
)
from slopewatch.workflows.batch.task_ids import FileHashes, task_id
from slopewatch.workflows.layer_files import LayerFiles

__all__ = ["las_file"]


def slope(*clouds: Path, **more: object) -> Slope:
    surveys = tuple(Survey(date(2024, 1 + n, 1), cloud) for n, cloud in enumerate(clouds))
    return Slope("A", surveys, **more)  # type: ignore[arg-type]


def test_a_task_is_another_one_where_anything_differs() -> None:
    first = (
        "inspect",
        [("2024-01-01", "aa"), ("2025-01-01", "bb")],
        {"roi": "cc"},
        effective("inspect", {}, "default"),
    )
    others = [
        ("series", *first[1:]),
        (first[0], [("2024-01-01", "aa"), ("2025-01-02", "bb")], *first[2:]),
        (first[0], [("2024-01-01", "ab"), ("2025-01-01", "bb")], *first[2:]),
        (*first[:2], {"stable": "cc"}, first[3]),
        (*first[:2], {}, first[3]),
        (*first[:3], effective("inspect", {"cell": 0.2}, "default")),
        (*first[:3], effective("inspect", {}, "paper")),
    ]
    ids = [task_id(*parts) for parts in (first, *others)]  # type: ignore[arg-type]
    assert len(set(ids)) == len(ids)
    assert task_id(*first) == ids[0]
    assert task_id(*first[:3], effective("inspect", {"confidence": 0.95}, "default")) == ids[0], "the default, given"


def test_a_file_is_read_again_only_when_it_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []
    from slopewatch.workflows.batch import task_ids

    whole = task_ids.sha256
    monkeypatch.setattr(task_ids, "sha256", lambda *paths: read.extend(paths) or whole(*paths))
    cloud, kept = tmp_path / "a.laz", tmp_path / "hashes.json"
    cloud.write_bytes(b"one")
    first = FileHashes(kept)
    found = first.of(cloud)
    first.save()
    assert FileHashes(kept).of(cloud) == found
    assert len(read) == 1
    cloud.write_bytes(b"two")
    os.utime(cloud, ns=(1, cloud.stat().st_mtime_ns + 1))
    assert FileHashes(kept).of(cloud) != found
    kept.write_text("[" * 9999)
    assert FileHashes(kept).of(cloud) != found
    with pytest.raises(InputError, match=r"gone\.laz"):
        FileHashes(kept).of(tmp_path / "gone.laz")


def test_one_survey_is_screened_two_are_compared_more_are_a_series(tmp_path: Path) -> None:
    clouds = [tmp_path / f"{n}.laz" for n in range(3)]
    assert [command_of(slope(*clouds[:n]), "inspect") for n in (1, 2, 3)] == ["inspect", "inspect", "series"]
    assert [command_of(slope(*clouds[:n]), "series") for n in (1, 2, 3)] == ["inspect", "series", "series"]


def test_settings_of_a_slope_override_those_of_all_where_its_command_has_them() -> None:
    own = slope(options={"cell": 0.2, "adaptive": False})
    common = {"cell": 0.5, "confidence": 0.99, "ground_ready": True, "rigidness": None}
    assert options_of(own, "inspect", common) == {"cell": 0.2, "adaptive": False, "confidence": 0.99}
    assert options_of(own, "series", common) == {
        "cell": 0.2, "adaptive": False, "confidence": 0.99, "ground_ready": True,
    }  # fmt: skip


@pytest.mark.parametrize("command", ["inspect", "series"])
def test_every_setting_is_understood_by_the_command_line(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each with a value other than its default, and texts that look like options."""
    options = {}
    for name, s in specifications(command).items():
        if s.kind is bool:
            options[name] = not s.default
        elif s.choices:
            options[name] = next(c for c in s.choices if c != s.default) if len(s.choices) > 1 else s.default
        elif s.kind in (int, float):
            options[name] = s.kind(s.minimum if s.minimum is not None else 1)
        else:
            options[name] = "--overwrite=x"
    files = {"roi": "--roi", "stable": "/a b/é.gpkg"}
    job = Job(
        "t", "A", command, (("2024-01-01", "/x=y/--a.laz"), ("2025-01-01", "/b.laz")), files, "paper", options, "/out"
    )
    given: dict[str, object] = {}
    target = cli.commands[command]
    monkeypatch.setattr(target, "callback", lambda **values: given.update(values))
    result = click.testing.CliRunner().invoke(cli, arguments_of(job))
    assert result.exit_code == 0, result.output
    assert {name: given[name] for name in options} == options
    assert given["epochs"] == ("2024-01-01=/x=y/--a.laz", "2025-01-01=/b.laz")
    assert (str(given["roi"]), given["profile"], given["overwrite"]) == ("--roi", "paper", True)


def test_the_estimate_grows_with_points_and_with_the_grid(las_file: LasFile, tmp_path: Path) -> None:
    small, large = las_file(tmp_path / "a.laz", points=2000), las_file(tmp_path / "b.laz", points=42_000)

    def need(*clouds: Path, cell: float = 0.5, method: str = "auto", motion: bool = False) -> int:
        options = {"cell": cell, "memory_limit": 4.0, "screening_method": method, "displacement": motion}
        return slope_memory(slope(*clouds), "inspect", group_of("inspect", options, "default"))

    assert need(small, large) - need(small, small) == pytest.approx(40_000 * 170, rel=0.01)
    extent = (500_000.0, 3_500_000.0, 500_030.0, 3_500_020.0)
    grids = [memory_needed(extent, 600.0, ChangeParameters(cell=cell), plants=True) for cell in (0.5, 0.05)]
    assert need(small, small, cell=0.05) - need(small, small) == pytest.approx(np.diff(grids)[0], rel=0.05)
    assert need(small, small, motion=True) - need(small, small) == motion_memory(4000) - 170 * 4000
    assert need(small, motion=True) == need(small), "one survey shows no motion"
    assert need(small) < need(small, small)
    assert need(small, method="network") - need(small) > 3e8, "only that method loads torch"
    assert need(small, small, cell=0.005) < 6e9, "more than memory_limit is refused by the slope itself"
    damaged = tmp_path / "c.laz"
    damaged.write_bytes(small.read_bytes()[:300])
    with pytest.raises(InputError, match=r"c\.laz"):
        need(damaged)


def test_the_budget_is_half_of_the_machine() -> None:
    pages = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 0 < machine_memory() <= pages
    assert default_budget(None) == machine_memory() // 2
    assert default_budget(7) == 7


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="ru_maxrss is in kilobytes on Linux")
@pytest.mark.parametrize(("side", "density"), [(14.0, 40.0), (24.0, 250.0)])
def test_motion_takes_no_more_than_is_estimated_and_not_much_less(side: float, density: float) -> None:
    """What a forked process grows by while it measures: a small cloud and one of 290,000 points.

    A small cloud's growth has no lower bound: it may fit into what the process held at its start.
    """
    heights = relief(side, 0.15, seed=3)
    clouds = [sampled(heights, density, 0.02, seed, 30.0) for seed in (1, 2)]
    grown = _growth(lambda: measure_displacement(*clouds, DisplacementParameters(), Registered.unknown()))
    estimated = motion_memory(sum(map(len, clouds)))
    assert (0.2 * estimated if density > 100 else 0) < grown < estimated, (grown, estimated)


def _growth(work: Callable[[], object]) -> int:
    """Bytes of resident memory at the peak of a forked process beyond what it has at its start.

    The allocator may keep memory that earlier tests freed; it is given back first, or it would hide the growth.
    """
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            ctypes.CDLL(None).malloc_trim(0)
            with open("/proc/self/statm", encoding="ascii") as file:
                before = int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE")
            with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
                file.write("5")  # the peak counts from here
            work()
            status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
            peak = next(line for line in status if line.startswith("VmHWM"))
            os.write(writer, str(int(peak.split()[1]) * 1024 - before).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as stream:
        text = stream.read()
    os.waitpid(child, 0)
    return int(text)


def test_corrections_of_the_corridor_go_to_the_slopes_that_they_lie_on(tmp_path: Path, las_file: LasFile) -> None:
    cloud = las_file(tmp_path / "2024-01-01.las")
    near, far, own = (tmp_path / name for name in ("near.gpkg", "far.gpkg", "own.gpkg"))
    for path, west in ((near, 500_005.0), (far, 600_000.0), (own, 500_005.0)):
        shape = box(west, 3_500_005, west + 5, 3_500_010)
        geopandas.GeoDataFrame({"action": ["exclude"]}, geometry=[shape], crs=32651).to_file(path)

    def corrections(given: Path, **more: object) -> str | None:
        common = Common({}, "default", None, None, BatchParameters(), LayerFiles(corrections=given))
        found = plan([slope(cloud, **more)], tmp_path, common, FileHashes(tmp_path / "h.json"), {}, Progress())
        assert not found.problems
        job = found.jobs["A"]
        assert any(a.startswith("--corrections=") for a in arguments_of(job)) == ("corrections" in job.files)
        return job.files.get("corrections")

    assert corrections(near) == str(near)
    assert corrections(far) is None
    assert corrections(far, corrections=own) == str(own)

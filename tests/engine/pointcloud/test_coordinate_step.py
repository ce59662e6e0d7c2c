"""The real step of coordinates: rounded clouds, 32-bit numbers, feet, grids and real clouds."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.pointcloud.coordinate_step import coordinate_step, judge_steps
from slopewatch.interface.parameters import InputParameters
from slopewatch.tests.builders.epoch_pairs import change, slope, write

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
AXES = {"x": 0, "y": 1, "z": 2}
US_FOOT_M = 1200 / 3937


def rounded(xyz: np.ndarray, axis: int, step: float, share: float = 1.0) -> np.ndarray:
    """A copy of which a share of the points lies on multiples of the step in one axis."""
    found = xyz.copy()
    chosen = np.random.default_rng(5).random(len(xyz)) < share
    found[chosen, axis] = np.round(xyz[chosen, axis] / step) * step
    return found


def grid(spacing: float, count: int = 80) -> np.ndarray:
    node = np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2) * spacing
    z = 0.6 * node[:, 1] + np.random.default_rng(1).normal(0, 0.03, len(node))
    return np.column_stack([node + [500_000, 3_500_000], z])


@pytest.mark.parametrize("axis", AXES.values(), ids=AXES)
@pytest.mark.parametrize("step", [0.5, 0.1, 0.05, 0.011, 0.01])
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_the_step_of_a_rounded_axis_is_found(tmp_path: Path, axis: int, step: float, share: float) -> None:
    steps = coordinate_step(write(tmp_path / "a.laz", rounded(slope(1), axis, step, share)))
    wanted = [0.001] * 3
    wanted[axis] = step
    assert steps == pytest.approx(wanted)


def test_a_cloud_of_32_bit_numbers(tmp_path: Path) -> None:
    xyz = slope(1).astype(np.float32).astype(float)
    assert coordinate_step(write(tmp_path / "a.laz", xyz))[:2] == pytest.approx([0.03125, 0.25])


@pytest.mark.parametrize(("step", "found"), [(0.01, 0.01), (0.1, 0.1), (0.5, 0.5)])
def test_feet(tmp_path: Path, step: float, found: float) -> None:
    feet = rounded(slope(1) / US_FOOT_M, 2, step)
    assert coordinate_step(write(tmp_path / "feet.laz", feet, 2225))[2] == pytest.approx(found * US_FOOT_M)
    metres = write(tmp_path / "metres.laz", feet * US_FOOT_M)
    assert coordinate_step(metres)[2] == pytest.approx(found * US_FOOT_M if step > 0.05 else 0.001)


@pytest.mark.parametrize("spacing", [0.25, 0.5, 1.0])
def test_the_spacing_of_a_grid_is_no_rounding(tmp_path: Path, spacing: float) -> None:
    xyz = grid(spacing)
    chosen = np.random.default_rng(2).permutation(len(xyz))[: int(0.7 * len(xyz))]
    for points in (xyz, xyz[chosen]):
        assert coordinate_step(write(tmp_path / "a.laz", points)) == pytest.approx([0.001] * 3)
    assert coordinate_step(write(tmp_path / "b.laz", rounded(xyz, 2, 0.5))) == pytest.approx([0.001, 0.001, 0.5])


@pytest.mark.parametrize("density", [1.0, 4.0, 40.0])
def test_rounding_in_both_axes_is_no_grid(tmp_path: Path, density: float) -> None:
    rng = np.random.default_rng(3)
    xy = np.round(rng.uniform(0, np.sqrt(20_000 / density), (20_000, 2)) * 2) / 2
    xyz = np.column_stack([xy + [500_000, 3_500_000], rng.normal(0, 3, 20_000)])
    assert coordinate_step(write(tmp_path / "a.laz", xyz)) == pytest.approx([0.5, 0.5, 0.001])


def test_few_points_and_level_ground_have_the_step_of_the_file(tmp_path: Path) -> None:
    flat = slope(1)
    flat[:, 2] = 7.0
    for points in (flat, slope(1)[:5], rounded(slope(1), 2, 0.5)[:20]):
        assert coordinate_step(write(tmp_path / "a.laz", points)) == pytest.approx([0.001] * 3)


@pytest.mark.parametrize(
    ("steps", "outcome"),
    [((0.001, 0.01, 0.01), ""), ((0.001, 0.011, 0.001), "warned"), ((0.1, 0.1, 0.1), "warned"),
     ((0.001, 0.001, 0.101), "refused"), ((0.5, 0.001, 0.001), "refused")],
)  # fmt: skip
def test_what_is_warned_of_and_refused(steps: tuple[float, float, float], outcome: str) -> None:
    progress = Progress()
    if outcome == "refused":
        with pytest.raises(InputError, match=r"^'a\.laz' has [xz] coordinates in steps of 0\.[0-9]+ m; export"):
            judge_steps(Path("a.laz"), steps, progress)
        return
    judge_steps(Path("a.laz"), steps, progress)
    assert bool(progress.warnings) == (outcome == "warned")


def test_a_command_refuses_such_a_cloud_and_records_the_step_of_others(tmp_path: Path) -> None:
    first, second = (write(tmp_path / f"202{n}-05-01.laz", slope(n)) for n in (1, 2))
    coarse = write(tmp_path / "2023-05-01.laz", rounded(slope(3), 1, 0.5))
    with pytest.raises(InputError, match=r"2023-05-01\.laz' has y coordinates in steps of 0\.5 m"):
        change(first, coarse)
    change(first, second)
    record = next(tmp_path.rglob("run.json")).read_text(encoding="utf-8")
    assert '"coordinate_step_m"' in record


REAL = sorted(DATA.rglob("*.la[sz]")) if DATA.is_dir() else []
SOUND = [p for p in REAL if p.parent.name not in ("bad_las", "isprs")]
SINGLE = [p for p in REAL if p.parent.name == "isprs"]
"""Went through 32-bit numbers: its northings of 5,400 km are multiples of 0.5 m."""


@pytest.mark.skipif(not REAL, reason="the real clouds are not here")
def test_no_real_cloud_is_refused_but_those_of_32_bit_numbers() -> None:
    given = InputParameters(crs="EPSG:32633")
    for path in SOUND:
        assert max(coordinate_step(path, given)) <= 0.010001, path
    for path in SINGLE:
        y = np.array(laspy.read(path).y)
        assert (y == y.astype(np.float32)).all()
        assert coordinate_step(path, given)[1] == pytest.approx(0.5), path

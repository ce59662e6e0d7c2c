"""The cloth gives the answer of its authors' library; refusals, gaps, cancelling."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.ground import cloth
from slopewatch.engine.ground.cloth import cloth_ground, refuse_large_cloth
from slopewatch.engine.ground.cloth_kernels import ABSENT, FRAME, MOVABLE, settle
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S

PLAIN = """
import json, sys, numpy, CSF
points, options = numpy.load(sys.argv[1]), json.loads(sys.argv[3])
cloth = CSF.CSF()
cloth.params.bSloopSmooth, cloth.params.cloth_resolution = options["slope_smoothing"], options["cloth_resolution"]
cloth.params.rigidness, cloth.params.time_step = options["rigidness"], options["time_step"]
cloth.params.class_threshold, cloth.params.interations = options["class_threshold"], options["iterations"]
cloth.setPointCloud(points)
ground, rest = CSF.VecInt(), CSF.VecInt()
cloth.do_filtering(ground, rest, False)
numpy.save(sys.argv[2], numpy.array(ground, dtype=int))
"""


def by_the_authors(xyz: np.ndarray, parameters: GroundParameters, folder: Path) -> np.ndarray:
    """(n,) points near the cloth of the authors' library, which prints and so runs in a process of its own."""
    if importlib.util.find_spec("CSF") is None:
        pytest.skip("the authors' library has no build for this Python")
    np.save(folder / "points.npy", xyz - xyz.min(axis=0))
    options = json.dumps(asdict(parameters))
    arguments = [sys.executable, "-c", PLAIN, folder / "points.npy", folder / "ground.npy", options]
    subprocess.run(arguments, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    found = np.zeros(len(xyz), dtype=bool)
    found[np.load(folder / "ground.npy")] = True
    return found


@pytest.fixture(scope="module")
def field() -> tuple[np.ndarray, np.ndarray]:
    """Rolling ground with bushes on it: coordinates, and which points are ground."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 30, (30_000, 2))
    z = 0.5 * np.sin(xy[:, 0] / 5) + rng.normal(0, 0.02, len(xy))
    bush = (np.hypot(xy[:, 0] % 6 - 3, xy[:, 1] % 6 - 3) < 1.2) & (rng.random(len(xy)) < 0.8)
    z[bush] += rng.uniform(0.6, 2.0, np.count_nonzero(bush))
    return np.column_stack([xy + [500_000, 3_500_000], z + 100]), ~bush


def test_ground_under_bushes_is_distinguished_from_them(field):
    xyz, truth = field
    found = cloth_ground(xyz, GroundParameters(cloth_resolution=0.5), threshold=0.15)
    assert (found & truth).sum() / truth.sum() > 0.97
    assert (found & truth).sum() / found.sum() > 0.99


@pytest.mark.parametrize(
    "options",
    [
        {"cloth_resolution": 0.5, "rigidness": 2, "iterations": 300, "class_threshold": 0.2},
        {"cloth_resolution": 0.3, "rigidness": 1, "time_step": 0.9, "slope_smoothing": True},
        {"cloth_resolution": 1.3, "rigidness": 3, "iterations": 5, "slope_smoothing": True},
    ],
)
def test_the_answer_is_that_of_the_authors_library(field, tmp_path, options):
    parameters = GroundParameters(**options)
    found = cloth_ground(field[0], parameters)
    assert 0.1 < found.mean() < 1.0
    assert np.array_equal(found, by_the_authors(field[0], parameters, tmp_path))
    assert not np.array_equal(found, cloth_ground(field[0], parameters, threshold=0.05))


@pytest.mark.parametrize("smooth", [False, True])
def test_the_answer_on_a_real_steep_slope_is_that_of_the_authors_library(shared_data, tmp_path, smooth):
    xyz = np.array(laspy.read(shared_data / "real" / "ign_tiles" / "alpine_slope.laz").xyz)
    parameters = GroundParameters(cloth_resolution=0.7, slope_smoothing=smooth)
    assert np.array_equal(cloth_ground(xyz, parameters), by_the_authors(xyz, parameters, tmp_path))


def test_particles_without_points_in_row_and_column_get_the_heights_of_the_authors_library(field, tmp_path):
    """Two regions corner to corner, 5 m apart: the search from neighbour to neighbour, and which it leaves marked."""
    both = np.vstack([field[0][:8000], field[0][:8000] + [36.0, 35.0, 3.0]])
    parameters = GroundParameters(cloth_resolution=0.5, slope_smoothing=True)
    assert len(cloth.filling(both, 0.5)) == 0, "else nothing is searched for"
    assert np.array_equal(cloth_ground(both, parameters), by_the_authors(both, parameters, tmp_path))


def test_numpys_way_gives_the_loops_cloth_to_the_last_bit():
    rng = np.random.default_rng(4)
    rows, row = 13 + 2 * FRAME, 17 + 2 * FRAME
    state = np.pad(np.full((13, 17), MOVABLE, np.uint8), FRAME, constant_values=ABSENT).ravel()
    ground = np.pad(np.cumsum(rng.normal(0, 0.1, (13, 17)), axis=1), FRAME, constant_values=np.nan).ravel()
    made = []
    for way in (settle, settle.plain):
        cloth = np.full(rows * row, 3.0)
        now = state.copy()
        steps = way(cloth, cloth.copy(), ground, now, row, np.array([0.3, 0.3]), -0.1, 30)
        made.append((steps, cloth, now))
    assert made[0][0] == made[1][0]
    assert 0 < np.count_nonzero(made[0][2] == MOVABLE) < 0.6 * 13 * 17, "some hang, some landed"
    for one, other in zip(made[0][1:], made[1][1:], strict=True):
        assert np.array_equal(one, other)


def test_what_has_no_answer_or_takes_too_long_is_refused(field):
    xyz, _ = field
    broken = xyz.copy()
    broken[7, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        cloth_ground(broken, GroundParameters())
    far = np.vstack([xyz, xyz[0] + [1e5, 1e5, 0]])
    with pytest.raises(InputError, match=r"cloth_resolution .* give at least ([\d.]+) m") as caught:
        refuse_large_cloth(far, 0.5)
    fits = float(str(caught.value).split("give at least ")[1].split(" m")[0])
    assert refuse_large_cloth(far, fits) <= cloth.MAX_CLOTH_PARTICLES
    assert len(cloth_ground(np.empty((0, 3)), GroundParameters())) == 0


def test_a_gap_between_two_regions_is_not_searched_for_hours(field):
    xyz, truth = field
    parameters = GroundParameters(cloth_resolution=0.5)
    assert len(cloth.filling(xyz, 0.5)) == 0
    both = np.vstack([xyz, xyz + [130.0, 130.0, 2.0]])
    started = time.monotonic()
    found = cloth_ground(both, parameters, threshold=0.15)
    assert time.monotonic() - started < PATIENCE_S
    for part in np.split(found, 2):
        assert (part & truth).sum() > 0.93 * truth.sum()
        assert (part & truth).sum() > 0.99 * part.sum()


LONG = """
import sys, tempfile
from pathlib import Path
sys.path.insert(0, {tests!r})
import conftest
import numpy as np
from slopewatch.engine.core import cancellation
from slopewatch.engine.ground.cloth import cloth_ground
from slopewatch.interface.parameters import GroundParameters
tempfile.tempdir = {folder!r}
cancellation.install(lambda: None, watch_parent=False)
rng = np.random.default_rng(0)
xyz = rng.uniform(0, 300, (400_000, 3)) * [1, 1, 0.1]
print("start", flush=True)
cloth_ground(xyz, GroundParameters(cloth_resolution=0.1, iterations=10000))
print("done", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_cancelling_ends_the_cloth_within_seconds_and_leaves_nothing(tmp_path, number):
    tests = str(Path(__file__).resolve().parents[2])
    script = LONG.format(tests=tests, folder=str(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "start\n"
    time.sleep(2)
    started = time.monotonic()
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == 130
    assert time.monotonic() - started < CANCELLED_S
    assert "done" not in process.communicate()[0]
    assert list(tmp_path.iterdir()) == []

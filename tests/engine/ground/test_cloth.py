"""The CSF library in its child process: same answer as called plainly, refusals, determinism, cancelling."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.engine.ground import cloth
from slopewatch.engine.ground.cloth import cloth_ground, refuse_large_cloth
from slopewatch.interface.parameters import GroundParameters
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S

PLAIN = """
import sys, numpy, CSF
points = numpy.load(sys.argv[1])
cloth = CSF.CSF()
cloth.params.bSloopSmooth = False
cloth.params.cloth_resolution, cloth.params.rigidness, cloth.params.time_step = 0.5, 2, 0.65
cloth.params.class_threshold, cloth.params.interations = 0.2, 300
cloth.setPointCloud(points)
ground, rest = CSF.VecInt(), CSF.VecInt()
cloth.do_filtering(ground, rest, False)
numpy.save(sys.argv[2], numpy.array(ground))
"""


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


def test_the_answer_is_that_of_the_library_called_plainly_with_these_parameters(field, tmp_path):
    xyz, _ = field
    np.save(tmp_path / "points.npy", xyz - xyz.min(axis=0))
    subprocess.run(
        [sys.executable, "-c", PLAIN, tmp_path / "points.npy", tmp_path / "ground.npy"],
        check=True,
        capture_output=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    parameters = GroundParameters(
        cloth_resolution=0.5, rigidness=2, time_step=0.65, iterations=300, class_threshold=0.2
    )
    found = cloth_ground(xyz, parameters)
    assert np.array_equal(np.flatnonzero(found), np.sort(np.load(tmp_path / "ground.npy")))
    assert not np.array_equal(found, cloth_ground(xyz, GroundParameters(cloth_resolution=0.5), threshold=0.05))


def test_the_same_points_give_the_same_ground_however_many_threads_the_caller_allows(field, monkeypatch):
    xyz, _ = field
    parameters = GroundParameters(cloth_resolution=0.2)
    first = cloth_ground(xyz, parameters)
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    assert np.array_equal(first, cloth_ground(xyz, parameters))


def test_what_would_crash_or_drown_the_library_is_refused(field):
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


def test_a_gap_between_two_regions_does_not_make_the_library_search_for_hours(field):
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


def test_a_library_that_may_not_take_the_memory_it_wants_is_an_error_not_a_crash(field, monkeypatch):
    monkeypatch.setattr(cloth, "_BYTES_FOR_ITSELF", 50_000_000)
    with pytest.raises(EngineError, match="cloth simulation failed"):
        cloth_ground(field[0], GroundParameters())


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
def test_cancelling_ends_the_library_within_seconds_and_leaves_nothing(tmp_path, number):
    tests = str(Path(__file__).resolve().parents[2])
    script = LONG.format(tests=tests, folder=str(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "start\n"
    child = _child_of(process.pid)
    time.sleep(0.5)
    started = time.monotonic()
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == 130
    assert time.monotonic() - started < CANCELLED_S
    assert "done" not in process.communicate()[0]
    deadline = time.monotonic() + CANCELLED_S
    while Path(f"/proc/{child}").exists() and "zombie" not in Path(f"/proc/{child}/status").read_text():
        assert time.monotonic() < deadline, "the library still runs"
        time.sleep(0.05)
    assert list(tmp_path.iterdir()) == []


def _child_of(pid: int) -> int:
    """The process that ``pid`` started, once it is the CSF worker."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for entry in Path("/proc").iterdir():
            try:
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                if parent == pid and "cloth_worker" in (entry / "cmdline").read_text():
                    return int(entry.name)
            except (OSError, ValueError, IndexError):
                continue
        time.sleep(0.02)
    raise AssertionError("the library was not started")


def test_without_the_library_it_says_what_to_install(field, monkeypatch, tmp_path):
    worker = tmp_path / "worker.py"
    worker.write_text("raise ModuleNotFoundError(\"No module named 'CSF'\", name='CSF')\n")
    monkeypatch.setattr(cloth, "_WORKER", worker)
    with pytest.raises(InputError, match=r"cloth filter .* is not there.*install PDAL 2\.3 or newer"):
        cloth_ground(field[0], GroundParameters())

"""``slopewatch simulate scenes``: what it writes, read back by other readers, against the simulation itself."""

from __future__ import annotations

import hashlib
import json

import geopandas
import laspy
import numpy as np
import pytest
from PIL import Image
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import ScenesParameters
from slopewatch.simulation.hazard_scenes.picture import draw_panels, panels
from slopewatch.simulation.hazard_scenes.scenes import scene
from slopewatch.simulation.hazard_scenes.sets import published_set
from slopewatch.simulation.hazard_scenes.styles import SIMULATOR_VERSION
from slopewatch.tests.builders.program import run
from slopewatch.workflows import simulate_scenes
from slopewatch.workflows.simulate_scenes import scene_specs, scenes_step

SMALL = ScenesParameters(kind="published", count=2, seed=1001, area=300.0, density=40.0)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "new"
    return scenes_step(SMALL, folder, Progress())


def test_points_carry_the_truth(written):
    outputs, metrics = written.outputs, written.figures
    total = 0
    for key, seed in (("scene", 1001), ("scene_2", 1002)):
        truth = scene(seed, "published", area=300.0, density=40.0)
        las = laspy.read(outputs[key])
        assert outputs[key].name == f"published_{seed:07d}.laz"
        assert las.header.parse_crs().is_projected
        np.testing.assert_allclose(np.column_stack([las.x, las.y, las.z]), truth.xyz, atol=0.00051)
        np.testing.assert_array_equal(las["truth_class"], truth.label)
        np.testing.assert_array_equal(las["truth_displacement"], truth.displacement)
        np.testing.assert_array_equal(las["truth_ignore"], truth.ignore)
        np.testing.assert_array_equal(las["negative"], truth.negative)
        np.testing.assert_array_equal(las["hazard"], truth.hazard)
        assert set(np.unique(las["truth_class"])) == {0, 1, 2}
        assert set(np.unique(las.classification)) == {2}
        total += len(truth)
    assert metrics["points"] == total


def test_the_hazards_lie_where_their_points_lie(written):
    outputs = written.outputs
    table = geopandas.read_file(outputs["hazards"], layer="hazards")
    assert set(table["class"]) == {"uplift", "subsidence"}
    las = laspy.read(outputs["scene"])
    mine = table[table["scene"] == outputs["scene"].name]
    for _, row in mine.iterrows():
        value = {"uplift": 1, "subsidence": 2}[row["class"]]
        points = (np.asarray(las["hazard"]) == row["id"]) & (np.asarray(las["truth_class"]) == value)
        if points.sum() < 20:
            continue
        middle = np.array([np.asarray(las.x)[points].mean(), np.asarray(las.y)[points].mean()])
        assert np.hypot(*(middle - (row.geometry.x, row.geometry.y))) < 0.35 * row["diameter_m"] + 0.3
        moved = np.abs(np.asarray(las["truth_displacement"])[points])
        assert 0.5 * row["amplitude_m"] < moved.max() <= row["amplitude_m"] * 1.02 + 0.01
    assert len(mine) > 5


def test_the_manifest_says_what_was_made(written):
    outputs, metrics = written.outputs, written.figures
    manifest = json.loads(outputs["manifest"].read_text())
    assert manifest["simulator_version"] == SIMULATOR_VERSION
    assert manifest["seed"] == 1001
    labels = np.concatenate([laspy.read(outputs[key])["truth_class"] for key in ("scene", "scene_2")])
    shares = np.bincount(labels, minlength=3) / len(labels)
    np.testing.assert_allclose(list(manifest["class_shares"].values()), shares, atol=1e-4)
    first = manifest["scenes"][0]
    las = laspy.read(outputs["scene"])
    counts = np.bincount(las["negative"], minlength=17)
    names = {int(number): name for number, name in manifest["negatives"].items()}
    assert first["negative_points"] == {names[k]: int(n) for k, n in enumerate(counts) if n}
    assert (first["file"], first["points"], first["seed"]) == (outputs["scene"].name, len(las.x), 1001)
    # A point is labelled from this displacement on.
    moved, label = np.abs(las["truth_displacement"]), np.asarray(las["truth_class"])
    assert moved[label > 0].min() >= first["label_limit_m"] - 1e-4
    assert moved[label == 0].max() <= first["label_limit_m"] + 1e-4
    run = json.loads(outputs["run"].read_text())
    assert run["metrics"]["points"] == metrics["points"]
    assert run["outputs"]["picture"] == "scenes.png"


def test_the_same_seed_gives_the_same_bytes_and_no_picture_if_so(written, tmp_path):
    outputs = written.outputs
    again = scenes_step(
        ScenesParameters(kind="published", count=1, seed=1002, area=300.0, density=40.0, picture=False),
        tmp_path,
        Progress(),
    ).outputs
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (again["scene"], outputs["scene_2"])]
    assert digests[0] == digests[1]
    assert "picture" not in again
    assert not (tmp_path / "scenes.png").exists()


def test_scenes_of_the_benchmark_set_are_the_sets_own():
    assert scene_specs(ScenesParameters(benchmark=True, count=3, seed=7, area=50.0)) == list(published_set().specs[:3])
    with pytest.raises(InputError, match="92 scenes; give at most 92"):
        scene_specs(ScenesParameters(benchmark=True, count=93))


def test_a_run_that_breaks_off_leaves_nothing(tmp_path, monkeypatch):
    calls = []

    def breaks(spec):
        calls.append(spec)
        if len(calls) == 2:
            raise MemoryError
        return scene(spec.seed, spec.kind, area=100.0, density=20.0)

    monkeypatch.setattr(simulate_scenes, "build_scene", breaks)
    with pytest.raises(MemoryError):
        scenes_step(SMALL, tmp_path / "out", Progress())
    assert list(tmp_path.iterdir()) == []


def test_the_program_tells_progress_and_refuses_bad_values(tmp_path):
    program = ("simulate", "scenes", "--output-dir", tmp_path / "o")
    size = ("--kind", "shifted", "--count", 2, "--area", 150, "--density", 25)
    done = run(*program, "--progress", "json", *size)
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    percents = [event["percent"] for event in events if event["event"] == "progress"]
    assert len(set(percents)) > 4
    assert percents == sorted(percents)
    assert events[-1]["event"] == "result"
    assert events[-1]["metrics"]["scenes"] == 2
    refused = run(*program, "--count", 0)
    assert refused.returncode == 2
    assert "count is 0" in refused.stderr


def test_a_small_picture_has_the_colours_of_the_labels(tmp_path):
    drawn = [panels(scene(seed, "published", area=200.0, density=40.0)) for seed in (1, 2, 3)]
    draw_panels(drawn, tmp_path / "a.png", across=2, width=8.0, small_file=True)
    draw_panels(drawn, tmp_path / "b.png", across=2, width=8.0)
    small, full = (np.asarray(Image.open(tmp_path / name).convert("RGB"), dtype=int) for name in ("a.png", "b.png"))
    assert (tmp_path / "a.png").stat().st_size < 0.6 * (tmp_path / "b.png").stat().st_size
    assert small.shape == full.shape
    assert np.abs(small - full).mean() < 12
    for colour in ((0x2A, 0x6B, 0xAE), (0xB4, 0x36, 0x28)):
        assert (small == colour).all(axis=2).any()

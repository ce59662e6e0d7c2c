"""``slopewatch train``: it learns, goes on where it stopped, and refuses with a sentence and nothing written."""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import FineTuneParameters, InputParameters
from slopewatch.models.configuration import SMOKE
from slopewatch.models.inference.calibration import fit_temperature, temperature_of
from slopewatch.models.training import tuning
from slopewatch.models.training.own_data import OwnCloud
from slopewatch.models.training.tuning import Tuning
from slopewatch.simulation.hazard_scenes.scenes import build_scene, scene
from slopewatch.simulation.hazard_scenes.styles import SceneSpec
from slopewatch.simulation.hazard_scenes.write import write_scene
from slopewatch.tests.builders.limits import CANCELLED_S, PATIENCE_S
from slopewatch.tests.builders.program import COMMAND
from slopewatch.workflows import train

pytestmark = pytest.mark.usefixtures("torch")
TINY = FineTuneParameters(dimension="truth_class", start="none", network="smoke", steps=2, batch=1, threads=1)


def program(*arguments, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", **variables}
    line = [*COMMAND, "train", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, check=False, env=environment)


@pytest.fixture(scope="module")
def clouds(tmp_path_factory) -> list[Path]:
    """Two scenes of 3,000 m²."""
    folder = tmp_path_factory.mktemp("clouds")
    paths = [folder / f"slope {seed}.laz" for seed in (1001, 1002)]
    for path, seed in zip(paths, (1001, 1002)):
        write_scene(path, scene(seed, "published", area=3000.0, density=20.0))
    return paths


@pytest.fixture(scope="module")
def tiny_clouds(tmp_path_factory) -> list[Path]:
    """Three scenes of 200 m², too small to learn from."""
    folder = tmp_path_factory.mktemp("tiny")
    paths = [folder / f"tiny_{seed}.laz" for seed in (1, 2, 3)]
    for path, seed in zip(paths, (1, 2, 3)):
        write_scene(path, scene(seed, "published", area=200.0, density=20.0))
    return paths


@pytest.fixture(scope="module")
def trained(torch_module, clouds, tmp_path_factory) -> tuple[Path, list[dict]]:
    """A small net trained through the program; its output folder and the events it reported."""
    folder = tmp_path_factory.mktemp("trained") / "out"
    done = program(
        *clouds, "--dimension", "truth_class", "--start", "none", "--network", "smoke", "--steps", "45",
        "--learning-rate", "0.02", "--output-dir", folder, "--progress", "json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, [json.loads(line) for line in done.stdout.splitlines()]


@pytest.fixture(scope="module")
def torch_module():
    return pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")


def step(paths, folder, parameters=TINY, progress=None, **options):
    return train.train_step(paths, folder, parameters, InputParameters(), progress=progress or Progress(), **options)


def test_a_small_net_beats_the_majority_within_a_minute(trained):
    _, events = trained
    metrics = events[-1]["metrics"]
    assert metrics["overall_accuracy"] > metrics["majority_accuracy"] + 0.06
    assert metrics["mean_iou"] > 0.4
    assert metrics["folds"] == 2
    percents = [event["percent"] for event in events if event["event"] == "progress"]
    assert percents == sorted(percents)
    assert len(set(percents)) > 30
    messages = " ".join(event["message"] for event in events if event["event"] == "progress")
    for words in ("fold", "training: step", "scoring slope 1001.laz"):
        assert words in messages


def test_the_weights_label_a_slope_that_nobody_trained_on(trained):
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.weights import load_model

    model = load_model(trained[0] / "model.safetensors")
    assert model.network.parameter_count < 30_000
    unseen = scene(77, "published", area=3000.0, density=20.0)
    right = (predict(model.network, unseen.xyz).labels == unseen.label).mean()
    assert right > max(unseen.shares) + 0.06


def test_every_labelled_point_is_scored_once_and_the_description_says_all(trained, clouds):
    folder, events = trained
    description = json.loads((folder / "model.json").read_text())
    scores = description["metrics"]["cross_validation"]
    truth = np.concatenate([laspy.read(path)["truth_class"] for path in clouds])
    counts = np.array(scores["confusion"])
    np.testing.assert_array_equal(counts.sum(axis=1), np.bincount(truth))
    assert scores["overall_accuracy"] == pytest.approx(np.trace(counts) / counts.sum(), abs=1e-4)
    assert scores["majority_accuracy"] == pytest.approx(np.bincount(truth).max() / len(truth), abs=1e-4)
    iou = [counts[k, k] / (counts[k].sum() + counts[:, k].sum() - counts[k, k]) for k in range(3)]
    assert scores["mean_iou"] == pytest.approx(np.mean(iou), abs=1e-4)
    training = description["training"]
    assert [file["sha256"] for file in training["files"]] == [
        hashlib.sha256(path.read_bytes()).hexdigest() for path in clouds
    ]
    names = [path.name for path in clouds]
    assert sorted(fold["test"] for fold in training["folds"]) == [[name] for name in names]
    for fold in training["folds"]:
        assert sorted(fold["train"] + fold["test"]) == names
    assert training["start"] is None
    assert description["configuration"]["density"][0] < 20 < description["configuration"]["density"][1]
    # What is in the description is what the held-out probabilities give.
    parts = [np.load(path) for path in sorted((folder / "training").glob("fold_*/held_out.npz"))]
    found = fit_temperature(*(np.concatenate([part[name] for part in parts]) for name in ("probabilities", "labels")))
    assert temperature_of(description) == pytest.approx(found.temperature, abs=1e-4)
    assert found.nll_after <= found.nll_before
    assert events[-1]["metrics"]["temperature"] == pytest.approx(found.temperature, abs=1e-3)


def test_log_and_report(trained, clouds):
    folder, _ = trained
    rows = list(csv.DictReader((folder / "log.csv").read_text().splitlines()))
    assert list(dict.fromkeys(row["training"] for row in rows)) == ["fold_0", "fold_1", "all"]
    last = [row for row in rows if row["training"] == "all"]
    assert int(last[-1]["step"]) == 45
    assert np.mean([float(r["loss"]) for r in last[-5:]]) < np.mean([float(r["loss"]) for r in last[:5]])
    report = (folder / "report.md").read_text()
    description = json.loads((folder / "model.json").read_text())
    assert description["sha256"] in report
    assert f"{100 * description['metrics']['cross_validation']['mean_iou']:.1f} %" in report
    for path in clouds:
        assert path.name in report
    run = json.loads((folder / "run.json").read_text())
    assert run["weights_sha256"] == description["sha256"]
    assert set(run["outputs"]) == {"weights", "description", "log", "report", "run"}


def test_fine_tuning_beats_the_weights_it_starts_from_on_another_kind_of_slope(trained, tmp_path):
    paths = []
    for seed in (5, 6):
        paths.append(tmp_path / f"{seed}.laz")
        write_scene(paths[-1], build_scene(SceneSpec("shifted", seed, 1500.0, 20.0, 0.15, 0.15)))
    start = trained[0] / "model.safetensors"
    parameters = FineTuneParameters(dimension="truth_class", start=str(start), steps=25, learning_rate=0.01, threads=1)
    done = step(paths, tmp_path / "out", parameters)
    outputs, metrics = done.outputs, done.figures
    assert metrics["mean_iou"] > metrics["start_mean_iou"] + 0.05
    assert metrics["overall_accuracy"] > metrics["start_overall_accuracy"] + 0.1
    digest = hashlib.sha256(start.read_bytes()).hexdigest()
    assert json.loads(outputs["description"].read_text())["training"]["start"]["sha256"] == digest
    assert "the weights it started from" in outputs["report"].read_text()


class Stopped(Exception):
    pass


class StopsAt(Progress):
    def __init__(self, message: str) -> None:
        super().__init__()
        self._message = message

    def emit(self, percent: float, message: str) -> None:
        if message == self._message:
            raise Stopped


def test_a_training_that_was_stopped_goes_on(tiny_clouds, tmp_path):
    whole = step(tiny_clouds, tmp_path / "whole").outputs
    with pytest.raises(Stopped):
        step(tiny_clouds, tmp_path / "parts", progress=StopsAt("scoring fold 2 of 3"))
    left = {path.name for path in (tmp_path / "parts").iterdir()}
    assert left == {"training"}
    done = (tmp_path / "parts/training/fold_0/scores.json").stat().st_mtime_ns
    resumed = step(tiny_clouds, tmp_path / "parts").outputs
    assert (tmp_path / "parts/training/fold_0/scores.json").stat().st_mtime_ns == done
    assert resumed["weights"].read_bytes() == whole["weights"].read_bytes()
    documents = [json.loads(outputs["description"].read_text()) for outputs in (whole, resumed)]
    assert documents[0] == documents[1]
    with pytest.raises(InputError, match=r"parts holds results already \(model\.safetensors\)"):
        step(tiny_clouds, tmp_path / "parts")
    with pytest.raises(InputError, match=r"parts/training holds a training on other data or with other settings"):
        step(tiny_clouds[:2], tmp_path / "parts", overwrite=True)
    assert resumed["weights"].read_bytes() == whole["weights"].read_bytes()
    (tmp_path / "parts/training/plan.json").write_text("{")
    with pytest.raises(InputError, match=r"plan\.json cannot be read .*; remove the folder"):
        step(tiny_clouds, tmp_path / "parts", overwrite=True)


def test_cancelling_leaves_only_what_the_next_run_goes_on_from(tiny_clouds, tmp_path):
    line = [
        *COMMAND, "train", *map(str, tiny_clouds), "--dimension", "truth_class",
        "--start", "none", "--network", "smoke", "--steps", "900000", "--output-dir", str(tmp_path / "out"),
    ]  # fmt: skip
    process = subprocess.Popen(
        line, stderr=subprocess.PIPE, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True
    )
    try:
        end = time.monotonic() + PATIENCE_S
        while not (tmp_path / "out/training/plan.json").is_file():
            assert time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        assert process.wait(CANCELLED_S) == 130
    finally:
        process.kill()
        process.communicate()
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"training"}
    assert not [path for path in tmp_path.rglob("*") if ".part" in path.name]


def test_one_file_trains_and_says_that_it_cannot_be_scored(tiny_clouds, tmp_path):
    progress = Progress()
    done = step(tiny_clouds[:1], tmp_path / "out", progress=progress)
    outputs, metrics = done.outputs, done.figures
    assert [w for w in progress.warnings if "With one file no honest score is possible" in w]
    assert metrics["mean_iou"] is None
    description = json.loads(outputs["description"].read_text())
    assert description["metrics"] == {"cross_validation": None, "calibration": None}
    assert temperature_of(description) == 1.0
    assert "None. With one file" in outputs["report"].read_text()


def test_more_files_than_folds_share_folds_and_minutes_choose_the_steps(tiny_clouds, tmp_path, monkeypatch):
    """On a machine where the timed steps take 0.2 s together, and scoring the smallest cloud as long."""
    clock = itertools.count(0.0, 0.2)
    monkeypatch.setattr(tuning, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    parameters = replace(TINY, folds=2, minutes=0.08, steps=9)
    done = step(tiny_clouds, tmp_path / "out", parameters)
    outputs, metrics = done.outputs, done.figures
    assert metrics["folds"] == 2
    trainings, step_s = 2 + 1, 0.2 / Tuning.timed_steps
    assert 0.5 * 60 * 0.08 < metrics["steps"] * trainings * step_s < 60 * 0.08
    tests = [fold["test"] for fold in json.loads(outputs["description"].read_text())["training"]["folds"]]
    assert sorted(map(len, tests)) == [1, 2]
    assert not (tmp_path / "out/training/timing").exists()


def test_labels_from_polygons(tiny_clouds, tmp_path):
    import geopandas
    from shapely import box

    rows = []
    for path in tiny_clouds[:2]:
        las = laspy.read(path)
        x, y = np.median(las.x), np.median(las.y)
        rows += [("uplift", box(x - 4, y - 4, x, y + 4)), ("subsidence", box(x, y - 4, x + 4, y + 4))]
    frame = geopandas.GeoDataFrame({"class": [r[0] for r in rows]}, geometry=[r[1] for r in rows], crs=32651)
    frame.to_file(tmp_path / "areas.gpkg")
    outputs = step(tiny_clouds[:2], tmp_path / "out", polygons=tmp_path / "areas.gpkg").outputs
    training = json.loads(outputs["description"].read_text())["training"]
    las = laspy.read(tiny_clouds[0])
    x, y = las.x - np.median(las.x), las.y - np.median(las.y)
    inside = (x > -4) & (x < 0) & (np.abs(y) < 4)
    assert training["files"][0]["points"]["uplift"] == pytest.approx(inside.sum(), abs=3)
    digest = hashlib.sha256((tmp_path / "areas.gpkg").read_bytes()).hexdigest()
    assert training["polygons"] == {"name": "areas.gpkg", "sha256": digest}


def test_start_weights_that_cannot_be_used(tiny_clouds, tmp_path, torch):
    torch.save({"a": torch.zeros(3)}, tmp_path / "pickled.pt")
    shutil.copy(tmp_path / "pickled.pt", tmp_path / "renamed.safetensors")
    for name, words in (
        ("pickled.pt", "pickled models are not opened"),
        ("renamed.safetensors", "no safetensors file"),
    ):
        with pytest.raises(InputError, match=words):
            step(tiny_clouds, tmp_path / "out", replace(TINY, start=str(tmp_path / name)))
    with pytest.raises(InputError, match=r"gone\.safetensors do not exist"):
        step(tiny_clouds, tmp_path / "out", replace(TINY, start=str(tmp_path / "gone.safetensors")))
    assert not (tmp_path / "out").exists()


def test_the_weights_given_say_which_network_is_trained(tmp_path, torch):
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.shipped import RELIEF_WEIGHTS
    from slopewatch.models.network.weights import save_model

    points = tmp_path / "points.safetensors"
    save_model(points, RandLANet(SMOKE), {}, {})
    for start, network, method in (
        ("shipped", "auto", "relief"),
        ("none", "auto", "relief"),
        ("shipped", "standard", "network"),
        ("none", "smoke", "network"),
        (str(points), "auto", "network"),
        (str(points), "standard", "network"),
        (str(RELIEF_WEIGHTS), "auto", "relief"),
        (str(RELIEF_WEIGHTS), "relief", "relief"),
    ):
        assert train.trained_method(FineTuneParameters(start=start, network=network)) == method
    for start, network in ((points, "relief"), (RELIEF_WEIGHTS, "standard")):
        with pytest.raises(InputError, match=f"which --network {network} is not; give --network auto"):
            train.trained_method(FineTuneParameters(start=str(start), network=network))
    assert train.start_weights(FineTuneParameters()).path == RELIEF_WEIGHTS


def test_slopes_that_are_hazards_for_the_most_part_are_warned_of():
    progress = Progress()
    labels = np.repeat(np.array([0, 1, 2, 255], dtype=np.uint8), (80, 12, 8, 100))
    few, many = (
        OwnCloud(Path(name), np.zeros((200, 3)), kept, name, 5.0)
        for name, kept in (("few.laz", np.where(labels == 2, 0, labels)), ("many.laz", labels))
    )
    train._warn_of_many_hazards([few, many], progress)
    (warning,) = progress.warnings
    assert "many.laz is labelled as hazard on 20 % of its known points" in warning
    assert "more than 15 %" in warning


def test_start_weights_with_other_classes_and_outputs_over_inputs(tiny_clouds, tmp_path, torch):
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.weights import save_model

    save_model(tmp_path / "model.safetensors", RandLANet(SMOKE), {}, {})
    described = json.loads((tmp_path / "model.json").read_text())
    described["configuration"]["classes"] = ["soil", "crack", "rock"]
    (tmp_path / "model.json").write_text(json.dumps(described))
    parameters = replace(TINY, start=str(tmp_path / "model.safetensors"))
    with pytest.raises(
        InputError, match="knows the classes soil, crack, rock where background, uplift, subsidence are needed"
    ):
        step(tiny_clouds, tmp_path / "out", parameters)
    save_model(tmp_path / "model.safetensors", RandLANet(SMOKE), {}, {})
    with pytest.raises(InputError, match=r"model\.safetensors is also an input"):
        step(tiny_clouds, tmp_path, parameters)
    assert {path.name for path in tmp_path.iterdir()} == {"model.safetensors", "model.json"}


def test_without_torch_the_program_says_what_to_install(tiny_clouds, tmp_path):
    (tmp_path / "broken/torch").mkdir(parents=True)
    (tmp_path / "broken/torch/__init__.py").write_text("raise ImportError('not here')\n")
    done = program(
        *tiny_clouds, "--start", "none", "--output-dir", tmp_path / "out", PYTHONPATH=str(tmp_path / "broken")
    )
    assert done.returncode == 2
    sentence = done.stderr.strip().splitlines()[-1]
    assert "Training needs the Python library torch, which cannot be imported (not here); run Set up engine" in sentence
    assert not (tmp_path / "out").exists()


def test_without_a_graphics_card(tiny_clouds, tmp_path, torch, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match="give --device cpu"):
        step(tiny_clouds, tmp_path / "out", replace(TINY, device="gpu"))
    assert not (tmp_path / "out").exists()


def test_bad_labels_leave_nothing(tiny_clouds, tmp_path):
    with pytest.raises(InputError, match="has no dimension slopewatch_class; give one of truth_class"):
        step(tiny_clouds, tmp_path / "out", replace(TINY, dimension="slopewatch_class"))
    with pytest.raises(InputError, match=r"values that are no class \("):
        step(tiny_clouds, tmp_path / "out", replace(TINY, dimension="negative"))
    few = tmp_path / "tiny_2.laz"
    las = laspy.read(tiny_clouds[1])
    las.points = las.points[:20]
    las.write(str(few))
    with pytest.raises(InputError, match=r"tiny_2\.laz cannot be trained on: There are 20 "):
        step([tiny_clouds[0], few], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_without_shipped_weights_the_sentence_says_what_to_do(tiny_clouds, tmp_path, monkeypatch):
    from slopewatch.models.network import shipped

    for name, network in (("RELIEF_WEIGHTS", "auto"), ("SHIPPED_WEIGHTS", "standard")):
        monkeypatch.setattr(shipped, name, tmp_path / "none.safetensors")
        with pytest.raises(InputError, match=r"comes without weights; .*--start none"):
            step(tiny_clouds, tmp_path / "out", FineTuneParameters(dimension="truth_class", network=network))
        monkeypatch.undo()
    assert not (tmp_path / "out").exists()

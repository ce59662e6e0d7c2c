"""Fine-tuning of the network on relief: it gets better on slopes that it was not trained on, and screening takes it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.interface.parameters import FineTuneParameters, InputParameters, ScreeningParameters
from slopewatch.models.inference.platt import fit_platt
from slopewatch.models.screening.method import with_method
from slopewatch.models.screening.relief import ReliefModel, calibration_of
from slopewatch.models.training.own_data import OwnCloud, read_own_clouds
from slopewatch.models.training.relief_patches import PatchParameters
from slopewatch.models.training.relief_tuning import ReliefStart, ReliefTuned, fine_tune_relief
from slopewatch.models.training.report import training_report
from slopewatch.tests.builders.screening_clouds import screen, slope, write

pytestmark = pytest.mark.usefixtures("torch")
PATCH = PatchParameters(side=32, structures=0.0, needs=(3.0, 8.0), diameters=(2.0, 6.0))
PARAMETERS = FineTuneParameters(steps=40, batch=4, learning_rate=0.02, threads=1)


def labelled(seed: int) -> OwnCloud:
    """A slope of 22 m, smaller than a patch of the shipped recipe, with a bulge and a hollow that are labelled."""
    xyz = slope(9000, seed=seed, noise=0.02)
    plain = slope(9000, seed=seed, noise=0.0)[:, 2]
    trend = np.polynomial.polynomial.polyfit(xyz[:, 1] - xyz[0, 1], plain, 1)
    raised = plain - np.polynomial.polynomial.polyval(xyz[:, 1] - xyz[0, 1], trend)
    labels = np.where(raised > 0.1, 1, np.where(raised < -0.1, 2, 0)).astype(np.uint8)
    return OwnCloud(Path(f"slope_{seed}.laz"), xyz, labels, f"{seed:064d}", 15.0)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory) -> tuple[ReliefTuned, Path, ReliefStart]:
    torch = pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.network.unet import UNet, save_unet

    torch.set_num_threads(1)
    torch.manual_seed(3)
    folder = tmp_path_factory.mktemp("tuned")
    save_unet(folder / "start.safetensors", UNet(UNetConfiguration(widths=(6, 8))).eval(), {}, {})
    start = ReliefStart.read(folder / "start.safetensors")
    return fine_tune_relief([labelled(1), labelled(2)], start, PARAMETERS, folder / "work", patch=PATCH), folder, start


def test_it_gets_better_on_slopes_that_it_was_not_trained_on(tuned):
    found, folder, _ = tuned
    scores = found.scores
    assert scores["mean_iou"] > scores["start_mean_iou"] + 0.1
    assert scores["hazards"] == 4
    assert scores["hazards_found"] > scores["start_hazards_found"]
    assert np.sum(scores["confusion"]) == np.sum(scores["start_confusion"]) == 18_000
    assert [fold["test"] for fold in scores["folds"]] in ([[0], [1]], [[1], [0]])
    parts = [np.load(path) for path in sorted((folder / "work").glob("fold_*/held_out.npz"))]
    kept = [np.concatenate([part[name] for part in parts]) for name in ("log_odds", "labels", "weights")]
    assert found.applied == pytest.approx(fit_platt(*kept))
    assert found.calibration.nll_after < found.calibration.nll_before
    assert found.figures()["hazard_recall"] == scores["hazard_recall"]


def test_done_again_nothing_is_trained_and_another_start_is_refused(tuned):
    found, folder, start = tuned
    begun = {path: path.stat().st_mtime_ns for path in (folder / "work").glob("fold_*/scores.json")}
    clouds = [labelled(1), labelled(2)]
    named = replace(PARAMETERS, network="relief")  # what auto stands for
    again = fine_tune_relief(clouds, start, named, folder / "work", patch=PATCH)
    assert begun == {path: path.stat().st_mtime_ns for path in begun}
    for name, tensor in found.network.state_dict().items():
        np.testing.assert_array_equal(again.network.state_dict()[name], tensor, err_msg=name)
    assert again.scores == found.scores
    with pytest.raises(InputError, match="holds a training on other data or with other settings"):
        fine_tune_relief(clouds, None, PARAMETERS, folder / "work", patch=PATCH)


def test_screening_takes_the_weights_and_their_calibration(tuned, tmp_path):
    found, _, _ = tuned
    files = [{"name": "a.laz", "sha256": "0" * 64, "points": labelled(1).counts, "density": 15.0}] * 2
    facts = {"start": None, "steps": 40, "files": files, "folds": [{"test": ["a.laz"]}] * 2}
    metrics = {"cross_validation": found.scores, "calibration": found.calibration.summary()}
    path = tmp_path / "own.safetensors"
    digest = found.save(path, facts, metrics)
    description = json.loads(path.with_suffix(".json").read_text())
    assert calibration_of(description) == pytest.approx(found.applied)
    assert description["training"]["recipe"]["patch"]["densities"] == list(PATCH.densities)
    parameters = with_method(ScreeningParameters(weights=str(path)))
    assert parameters.screening_method == "relief"
    assert ReliefModel(parameters).facts()["calibration"]["shift"] == pytest.approx(found.applied[1])
    report = training_report(facts, metrics, digest, [])
    assert f"| trained | 4 | {found.scores['hazards_found']} |" in report
    assert f"Scale {found.calibration.scale:.3f} and shift {found.calibration.shift:+.3f}" in report
    cloud = write(tmp_path / "slope.laz", slope(9000, seed=7))
    done = screen(cloud, tmp_path / "labelled.laz", method="auto", weights=str(path))
    assert json.loads(done.outputs["run"].read_text())["model"]["sha256"] == digest


def test_one_cloud_is_trained_on_without_scores_and_keeps_the_calibration_of_its_start(tuned, tmp_path):
    start = replace(tuned[2], description={**tuned[2].description, "calibration": {"scale": 0.5, "shift": -1.0}})
    cloud = labelled(1)
    only = replace(cloud, labels=np.where(cloud.labels == 0, 255, cloud.labels).astype(np.uint8))
    progress = Progress()
    found = fine_tune_relief([only], start, replace(PARAMETERS, steps=2), tmp_path, patch=PATCH, progress=progress)
    assert (found.scores, found.calibration, found.applied) == (None, None, (0.5, -1.0))
    assert found.figures()["hazard_recall"] is None


def test_clouds_that_cannot_be_trained_on_are_named(tmp_path):
    few = labelled(1)
    few = replace(few, xyz=few.xyz[:300], labels=few.labels[:300])
    with pytest.raises(InputError, match=r"slope_1\.laz has 300 points; at least 400"):
        fine_tune_relief([few, labelled(2)], None, PARAMETERS, tmp_path / "few", patch=PATCH)
    one = labelled(1)
    path = write(tmp_path / "unknown.laz", one.xyz, slopewatch_class=np.full(len(one.xyz), 255, dtype=np.uint8))
    with pytest.raises(InputError, match=r"unknown\.laz.* has no labelled point"):
        read_own_clouds([path], FineTuneParameters(), InputParameters(), None, Progress())
    path = write(tmp_path / "known.laz", one.xyz, slopewatch_class=one.labels)
    with pytest.raises(InputError, match="are the same cloud"):
        read_own_clouds([path, path], FineTuneParameters(), InputParameters(), None, Progress())

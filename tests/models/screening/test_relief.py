"""The network on relief as a method of screening: which method runs, what it finds, tells and refuses."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import geopandas
import laspy
import numpy as np
import pytest
from slopewatch.engine.core.checksums import sha256
from slopewatch.engine.core.errors import InputError
from slopewatch.engine.core.progress import Progress
from slopewatch.engine.grid.geotiff import read_raster
from slopewatch.engine.pointcloud.reading import read_cloud
from slopewatch.interface.parameters import ScreeningParameters
from slopewatch.models.network.description import POINTS, RELIEF, kind_of
from slopewatch.models.network.shipped import RELIEF_SHA256, RELIEF_WEIGHTS, SHIPPED_WEIGHTS
from slopewatch.models.screening.method import with_method
from slopewatch.models.screening.relief import calibrated_logits, calibration_of
from slopewatch.tests.builders.screening_clouds import (
    BULGE,
    HOLLOW,
    SOUTH,
    WEST,
    screen,
    screen_cloud,
    slope,
    small_weights,
    write,
)

pytestmark = pytest.mark.usefixtures("torch")


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", slope())


@pytest.fixture
def weights(tmp_path) -> Path:
    """The shipped ones, to be changed."""
    for ending in (".safetensors", ".json"):
        shutil.copy(RELIEF_WEIGHTS.with_suffix(ending), tmp_path / f"own{ending}")
    return tmp_path / "own.safetensors"


def stated(weights: Path, **facts) -> str:
    description = weights.with_suffix(".json")
    description.write_text(json.dumps(json.loads(description.read_text()) | facts))
    return str(weights)


def test_the_shipped_weights_are_those_pinned():
    assert sha256(RELIEF_WEIGHTS) == RELIEF_SHA256
    assert (kind_of(RELIEF_WEIGHTS), kind_of(SHIPPED_WEIGHTS)) == (RELIEF, POINTS)


def test_by_default_the_bulge_and_the_hollow_are_found(cloud, tmp_path):
    done = screen(cloud, tmp_path / "out.laz", method="auto")
    zones = geopandas.read_file(done.outputs["zones"], layer="zones").set_index("kind")
    assert sorted(zones.index) == ["subsidence", "uplift"]
    for kind, place in (("uplift", BULGE), ("subsidence", HOLLOW)):
        centre = zones.loc[kind].geometry.centroid
        assert np.hypot(centre.x - WEST - place[0], centre.y - SOUTH - place[1]) < 0.8
    assert set(zones["method"]) == {f"relief {RELIEF_SHA256[:12]}"}
    record = json.loads(done.outputs["run"].read_text())
    assert record["method"] == "relief"
    assert (record["model"]["kind"], record["model"]["sha256"]) == (RELIEF, RELIEF_SHA256)
    assert record["parameters"]["screening"]["screening_method"] == "auto"
    assert "to be found by screening" in record["detectable"]
    # what the labels, the zones and the raster say is one thing
    las = laspy.read(tmp_path / "out.laz")
    hazard, up = (read_raster(done.outputs["probability"], band).array for band in (1, 2))
    assert (np.nan_to_num(up) <= np.nan_to_num(hazard)).all()
    for kind, name in ((1, "uplift"), (2, "subsidence")):
        share = zones.loc[name]["points"] / (las.slopewatch_class == kind).sum()
        assert share == pytest.approx(1.0, abs=0.03)
        own = las.slopewatch_prob[las.slopewatch_class == kind].mean()
        assert own == pytest.approx(zones.loc[name]["probability"], abs=0.03)


def test_what_is_a_zone_does_not_depend_on_the_calibration(cloud, weights):
    points = read_cloud(cloud)

    def screened(**facts):
        parameters = ScreeningParameters(weights=stated(weights, **facts), threads=1)
        return screen_cloud(points, parameters)[0]

    plain = screened(calibration={"scale": 1.0, "shift": 0.0})
    doubtful = screened(calibration={"scale": 0.5, "shift": -12.0})
    np.testing.assert_array_equal(plain.labels, doubtful.labels)
    assert (plain.labels > 0).any()
    odds = [np.log(one.probabilities[:, 1] / one.probabilities[:, 0]) for one in (plain, doubtful)]
    np.testing.assert_allclose(odds[1], 0.5 * odds[0] - 12.0, atol=1e-3)
    assert doubtful.probabilities[doubtful.labels > 0, 1:].max() < 0.5
    assert doubtful.at(points.xyz)[0].any()


def test_labels_do_not_depend_on_the_threads(cloud):
    points = read_cloud(cloud)
    found = [screen_cloud(points, ScreeningParameters(threads=n))[0] for n in (1, 3)]
    np.testing.assert_array_equal(found[0].probabilities, found[1].probabilities)


def test_torch_says_the_same_but_for_the_last_digits(cloud):
    points = read_cloud(cloud)
    plain, by_torch = (screen_cloud(points, ScreeningParameters(device=device))[0] for device in ("cpu", "auto"))
    assert ("numpy" in plain.model, "torch" in by_torch.model) == (True, True)
    np.testing.assert_array_equal(plain.labels, by_torch.labels)
    assert set(np.unique(plain.labels)) == {0, 1, 2}
    np.testing.assert_allclose(plain.probabilities, by_torch.probabilities, atol=1e-5)


def test_improbable_zones_are_left_out_as_a_whole(cloud, weights):
    points = read_cloud(cloud)
    soft = stated(weights, calibration={"scale": 0.2, "shift": -1.0})
    every, hazards = screen_cloud(points, ScreeningParameters(weights=soft))
    kinds = hazards.frame.set_index("kind")
    highest = {kind: every.probabilities[every.labels == kind, kind].max() for kind in (1, 2)}
    between = (highest[1] + highest[2]) / 2
    kept = max(highest, key=lambda kind: highest[kind])
    assert highest[3 - kept] < between < highest[kept]
    some, hazards = screen_cloud(points, ScreeningParameters(weights=soft, minimum_probability=float(between)))
    np.testing.assert_array_equal(some.labels, np.where(every.labels == kept, kept, 0))
    name = ("", "uplift", "subsidence")[kept]
    assert hazards.frame["kind"].tolist() == [name]
    assert hazards.frame["area_m2"].iloc[0] == kinds.loc[name]["area_m2"]


def test_more_accepted_false_zones_show_more(cloud, tmp_path):
    few, many = (screen(cloud, tmp_path / f"{n}.laz", method="relief", false_zones=n) for n in (0.2, 10.0))
    assert 0 < few.figures["zone_area_m2"] < many.figures["zone_area_m2"]


def test_the_weights_say_which_method_runs(weights, tmp_path):
    points = str(small_weights(tmp_path / "points.safetensors"))

    def method(**given) -> str:
        return with_method(ScreeningParameters(**given)).screening_method

    assert method() == "relief"
    assert method(weights=str(weights)) == "relief"
    assert method(weights=points) == "network"
    assert method(weights=points, screening_method="network") == "network"
    assert method(weights=points, screening_method="filter") == "filter"
    assert [method(screening_method=name) for name in ("network", "residual")] == ["network", "residual"]
    with pytest.raises(InputError, match="those of a RandLA-Net, for the method network; give --screening-method net"):
        method(weights=points, screening_method="relief")
    with pytest.raises(InputError, match=r"those of a relief U-Net, .* or weights for network\."):
        method(weights=str(weights), screening_method="network")
    with pytest.raises(InputError, match="those of a oracle, which this version does not know"):
        method(weights=stated(weights, kind="oracle"))
    with pytest.raises(InputError, match="do not exist"):
        method(weights=str(tmp_path / "none.safetensors"))


def test_which_method_runs_is_told(cloud, tmp_path):
    class Listener(Progress):
        def show(self, level: str, message: str) -> None:
            told.append(message)

    told: list[str] = []
    points = small_weights(tmp_path / "points.safetensors")
    done = screen(cloud, tmp_path / "out.laz", method="auto", weights=str(points), progress=Listener())
    assert told.count("Screening by the method network.") == 1
    assert json.loads(done.outputs["run"].read_text())["method"] == "network"


def test_probabilities_are_those_of_platt():
    logits = np.random.default_rng(0).normal(0, 3, (3, 5, 4)).astype(np.float32)
    plain, scaled = calibrated_logits(logits, 1.0, 0.0), calibrated_logits(logits, 0.6, -1.5)
    exponential = np.exp(logits.astype(float))
    np.testing.assert_allclose(plain, exponential / exponential.sum(axis=0), rtol=1e-5)
    np.testing.assert_allclose(scaled.sum(axis=0), 1.0, rtol=1e-6)
    for kind in (1, 2):
        before, after = (np.log(p[kind] / p[0]) for p in (plain, scaled))
        np.testing.assert_allclose(after, 0.6 * before - 1.5, atol=1e-4)


@pytest.mark.parametrize("wrong", [{"scale": 0}, {"scale": "1"}, {"shift": float("nan")}, {"shift": True}, 3])
def test_what_is_no_calibration_is_refused(wrong):
    assert calibration_of({}) == (1.0, 0.0)
    assert calibration_of({"calibration": {"scale": 2, "shift": -1.5}}) == (2.0, -1.5)
    with pytest.raises(InputError, match="calibration"):
        calibration_of({"calibration": wrong})


def test_ground_sparser_than_the_network_is_made_for_is_refused(tmp_path):
    sparse = write(tmp_path / "sparse.laz", slope(280))
    with pytest.raises(
        InputError, match=r"has 0\.[45]\d? points a m² where the method relief was made for 0\.8 to 450"
    ):
        screen(sparse, tmp_path / "out.laz", method="relief")


def test_a_stopped_screening_ends_in_the_network(cloud):
    class Stopped(Progress):
        def emit(self, percent: float, message: str) -> None:
            if percent > 45:
                raise KeyboardInterrupt

    from slopewatch.interface.parameters import InputParameters
    from slopewatch.models.screening.cloud_file import ScreenedFile
    from slopewatch.models.screening.screen import screen_points

    with pytest.raises(KeyboardInterrupt):
        screen_points(ScreenedFile(cloud, InputParameters(), ground="auto"), ScreeningParameters(), Stopped())

"""The benchmark's scores against screenings whose outcome is known."""

from __future__ import annotations

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.lab.benchmarks.own_relief import OwnRelief, fitted_height, own_relief
from slopewatch.lab.benchmarks.real_screening import RealGround, main, recall, screenings, shown_zones, trials
from slopewatch.lab.benchmarks.screening_picture import draw
from slopewatch.simulation.hazard_scenes.known_hazards import put_hazards

DIP = np.radians(30.0)
NORMAL = np.array([0.0, -np.sin(DIP), np.cos(DIP)])


def slope(density: float = 20.0, side: float = 24.0, noise: float = 0.01) -> np.ndarray:
    """An even slope that dips south; x along it."""
    rng = np.random.default_rng(4)
    u, w = rng.uniform(0, side, (2, int(density * side**2)))
    n = rng.normal(0, noise, len(u))
    return np.column_stack([u, w * np.cos(DIP) - n * np.sin(DIP), w * np.sin(DIP) + n * np.cos(DIP)])


@pytest.fixture(scope="module")
def even() -> np.ndarray:
    return slope()


def height(xyz: np.ndarray) -> np.ndarray:
    """Above the plane, whose place is known exactly."""
    return xyz @ NORMAL


def as_probabilities(classes: np.ndarray) -> np.ndarray:
    return np.eye(3, dtype=np.float32)[classes]


def knowing(xyz: np.ndarray) -> np.ndarray:
    return as_probabilities(np.where(height(xyz) > 0.035, 1, np.where(height(xyz) < -0.035, 2, 0)))


def blind(xyz: np.ndarray) -> np.ndarray:
    return as_probabilities(np.zeros(len(xyz), dtype=int))


def alarmed(xyz: np.ndarray) -> np.ndarray:
    """All is uplift."""
    return as_probabilities(np.ones(len(xyz), dtype=int))


@pytest.mark.parametrize(("screening", "found", "before"), [(knowing, 1.0, 0.0), (blind, 0.0, 0.0)])
def test_recall_of_a_screening_that_knows_and_of_a_blind_one(even, screening, found, before):
    results = trials(even, screening, 0.3, 3.0, count=9)
    assert len(results) >= 9
    assert recall(results) == (found, before)
    assert {abs(trial.height) for trial in results} == {0.3}


def test_what_is_shown_anyhow_is_given_with_the_recall(even):
    results = trials(even, alarmed, 0.3, 3.0, count=12)
    bulges = np.mean([trial.height > 0 for trial in results])
    assert 0.3 < bulges < 0.7
    assert recall(results) == (bulges, bulges)


def test_zones_are_where_they_are_and_as_large_and_high(even):
    u, w = even[:, 0], even @ np.array([0.0, np.cos(DIP), np.sin(DIP)])
    raised = (np.abs(u - 6.0) < 1.5) & (np.abs(w - 7.0) < 1.0)
    lowered = (np.abs(u - 17.0) < 1.0) & (np.abs(w - 15.0) < 1.0)
    speck = (np.abs(u - 12.0) < 0.2) & (np.abs(w - 3.0) < 0.2)
    xyz = even + np.outer(0.2 * raised - 0.3 * lowered, NORMAL)
    ground = RealGround.of("even", xyz, "simulated")
    assert ground.dip == pytest.approx(30.0, abs=0.5)
    assert ground.density == pytest.approx(20.0, rel=0.1)
    assert ground.area == pytest.approx(24.0**2, rel=0.12)
    zones = shown_zones(ground, as_probabilities(np.where(raised | speck, 1, np.where(lowered, 2, 0))))
    assert [zone.kind for zone in zones] == [1, 2]
    for zone, members, area, high in ((zones[0], raised, 6.0, 0.2), (zones[1], lowered, 4.0, -0.3)):
        assert zone.area == pytest.approx(area, rel=0.4)
        assert len(np.setdiff1d(zone.members, np.flatnonzero(members))) < 0.25 * zone.points
        assert zone.place == pytest.approx(xyz[members].mean(axis=0), abs=0.3)
        assert zone.height == pytest.approx(high, abs=0.04)


def test_own_relief_is_nothing_on_even_ground_and_the_waves_put_in_elsewhere(even):
    flat = own_relief(even, 3.0, seeds=6)
    assert len(flat.heights) == 18
    assert flat.spread < 0.01
    assert flat.standing_out(0.3, 0.1) == 1.0
    waves = 0.6 * np.sin(2 * np.pi * even[:, 0] / 6.0)  # half a wave is 3 m wide
    rough = own_relief(even + np.outer(waves, NORMAL), 3.0, seeds=6)
    assert rough.spread > 10 * flat.spread
    assert flat.standing_out(0.1, 0.1) == 1.0
    assert rough.standing_out(0.1, 0.1) < 0.6


def test_the_fitted_height_is_the_shapes_own():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-3, 3, (2, 400))
    shape = np.maximum(1 - (x**2 + y**2) / 2.25, 0.0)
    z = 0.1 * x - 0.02 * y + 0.03 * x * x - 0.02 * x * y - 0.25 * shape + rng.normal(0, 0.005, len(x))
    assert fitted_height(np.column_stack([x, y, z]), shape) == pytest.approx(-0.25, abs=0.01)


def test_what_stands_out_is_what_normal_heights_say():
    """Threshold 1.645 deviations for 10 % on both sides; 2 deviations stand above it with probability 0.639."""
    heights = np.random.default_rng(1).normal(0, 0.15, 200_000)
    assert OwnRelief(3.0, heights).spread == pytest.approx(0.15, rel=0.02)
    assert OwnRelief(3.0, heights).standing_out(0.30, 0.1) == pytest.approx(0.639, abs=0.01)


def test_the_network_screens_with_the_weights_given(even, tmp_path):
    """A network of random weights, compared with its own prediction."""
    torch = pytest.importorskip("torch")
    from slopewatch.models.configuration import SMOKE
    from slopewatch.models.inference.prediction import predict
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.weights import save_model

    torch.manual_seed(3)
    network = RandLANet(SMOKE).eval()
    save_model(tmp_path / "random.safetensors", network, {}, {})
    found = screenings(tmp_path / "random.safetensors")
    assert list(found) == ["network", "residual"]
    assert found["network"](even) == pytest.approx(predict(network, even).probabilities, abs=1e-6)


def test_the_picture_shows_hazards_put_in_and_zones_where_they_are(even, tmp_path):
    image = pytest.importorskip("matplotlib.image")
    scene = put_hazards(even, [(0.3, 3.0)], 1)
    ground = RealGround.of("even", scene.xyz, "simulated")
    pictures = []
    for name, classes, truth in (
        ("none", np.zeros_like(scene.label), None),
        ("truth", np.zeros_like(scene.label), scene),
        ("found", scene.label, None),
    ):
        probabilities = as_probabilities(classes)
        draw(tmp_path / f"{name}.png", ground, probabilities, shown_zones(ground, probabilities), truth)
        pictures.append(image.imread(tmp_path / f"{name}.png")[..., :3])
    blue = [np.argwhere((p[..., 0] < 0.3) & (p[..., 1] < 0.5) & (p[..., 2] > 0.6)) for p in pictures]
    assert len(blue[0]) == 0
    # the points found lie within the outline of what was put in (line widths and markers beyond by some pixels)
    assert len(blue[1]) > 100
    assert len(blue[2]) > 100
    assert np.all(blue[2].min(axis=0) >= blue[1].min(axis=0) - 8)
    assert np.all(blue[2].max(axis=0) <= blue[1].max(axis=0) + 8)


def test_weights_that_are_not_there_are_refused(tmp_path):
    with pytest.raises(InputError, match="none"):
        main(["--weights", str(tmp_path / "none.safetensors")])

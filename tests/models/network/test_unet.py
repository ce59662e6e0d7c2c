"""The raster network: rasters of any size, mirrored looks, weights on disk."""

from __future__ import annotations

import json

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError


@pytest.fixture
def network(torch):
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.network.unet import UNet

    torch.manual_seed(3)
    return UNet(UNetConfiguration(widths=(4, 6, 8))).eval()


def some_channels(columns: int, rows: int) -> np.ndarray:
    from slopewatch.models.preparation.relief_channels import CHANNELS

    return np.random.default_rng(5).normal(size=(len(CHANNELS), columns, rows)).astype(np.float32)


def test_the_usual_network_is_small(torch):
    from slopewatch.models.network.relief_looks import UNetConfiguration
    from slopewatch.models.network.unet import UNet

    assert 0.2e6 <= UNet(UNetConfiguration()).parameter_count <= 0.5e6


def test_any_size_gives_a_logit_for_each_cell_and_class(network):
    from slopewatch.models.network.relief_looks import raster_logits

    for columns, rows in ((16, 24), (17, 9), (1, 30)):
        assert raster_logits(network, some_channels(columns, rows)).shape == (3, columns, rows)


def test_mirrored_looks_make_the_answer_symmetric(network):
    from slopewatch.models.network.relief_looks import raster_logits
    from slopewatch.models.preparation.relief_channels import upside_down

    channels = some_channels(16, 16)
    found = raster_logits(network, channels)
    inverse = raster_logits(network, upside_down(channels))
    np.testing.assert_allclose(inverse, found[[0, 2, 1]], atol=1e-5)
    np.testing.assert_allclose(raster_logits(network, channels[:, ::-1].copy())[:, ::-1], found, atol=1e-5)
    assert np.abs(raster_logits(network, channels, mirrored=False) - found).max() > 1e-3


@pytest.mark.parametrize("threads", [1, 3])
def test_tiles_give_what_the_whole_raster_gives(network, threads):
    from slopewatch.engine.core.progress import Progress
    from slopewatch.models.network.relief_looks import raster_logits

    class Listener(Progress):
        def emit(self, percent, _message):
            seen.append(percent)

    seen = []
    channels = some_channels(150, 91)
    whole = raster_logits(network, channels)
    tiled = raster_logits(network, channels, tile=24, threads=threads, progress=Listener())
    np.testing.assert_allclose(tiled, whole, atol=1e-5)
    assert len(seen) > 50
    assert seen == sorted(seen)


def test_nothing_beyond_the_margin_changes_an_answer(network):
    from slopewatch.models.network.relief_looks import raster_logits

    margin = network.configuration.margin
    channels = some_channels(3 * margin, 8)
    before = raster_logits(network, channels, mirrored=False)
    for place in range(margin, margin + network.configuration.multiple):
        changed = channels.copy()
        changed[:, place] += 100.0
        moved = np.flatnonzero(np.abs(raster_logits(network, changed, mirrored=False) - before).max(axis=(0, 2)) > 0)
        assert place - margin <= moved.min() < place - margin / 2
        assert place + margin / 2 < moved.max() <= place + margin


def test_a_stop_ends_the_work_on_tiles(network):
    from slopewatch.engine.core.progress import Progress
    from slopewatch.models.network.relief_looks import raster_logits

    class Stopped(Progress):
        def emit(self, percent, _message):
            if percent > 10:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        raster_logits(network, some_channels(64, 64), tile=8, progress=Stopped())


def test_log_odds_are_those_of_the_probabilities(network, torch):
    from slopewatch.models.network.relief_looks import log_odds, raster_logits

    logits = raster_logits(network, some_channels(8, 8))
    probability = torch.softmax(torch.from_numpy(logits), dim=0).numpy()
    for odds, p in zip(log_odds(logits), probability[1:], strict=True):
        np.testing.assert_allclose(odds, np.log(p / (1 - p)), atol=1e-4)


def test_weights_come_back_as_they_were(network, tmp_path):
    from slopewatch.models.network.relief_looks import raster_logits
    from slopewatch.models.network.unet import load_unet, save_unet

    path = tmp_path / "relief.safetensors"
    digest = save_unet(path, network, {"steps": 3}, {})
    back, description = load_unet(path, digest)
    assert back.configuration == network.configuration
    assert description["training"] == {"steps": 3}
    channels = some_channels(16, 16)
    np.testing.assert_array_equal(raster_logits(back, channels), raster_logits(network, channels))


def test_other_or_changed_weights_are_refused(network, torch, tmp_path):
    from slopewatch.models.configuration import SMOKE
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.unet import load_unet, save_unet
    from slopewatch.models.network.weights import save_model

    points = tmp_path / "points.safetensors"
    save_model(points, RandLANet(SMOKE), {}, {})
    with pytest.raises(InputError, match="not those of a relief U-Net"):
        load_unet(points)
    path = tmp_path / "relief.safetensors"
    save_unet(path, network, {}, {})
    description = path.with_suffix(".json")
    stated = json.loads(description.read_text())
    stated["configuration"]["widths"] = [4, 8, 8]
    description.write_text(json.dumps(stated))
    with pytest.raises(InputError, match="do not fit"):
        load_unet(path)
    stated["configuration"] |= {"widths": [4, 6, 8], "cell": 1.0}
    description.write_text(json.dumps(stated))
    with pytest.raises(InputError, match="other channels or cells"):
        load_unet(path)

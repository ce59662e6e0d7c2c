"""The network on relief by numpy, against torch."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys

import numpy as np
import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.models.network.plain_unet import doubled, halved, load_plain_unet
from slopewatch.models.network.relief_looks import UNetConfiguration, raster_logits
from slopewatch.models.network.shipped import shipped_relief
from slopewatch.models.preparation.relief_channels import CHANNELS


def some_channels(columns: int, rows: int) -> np.ndarray:
    return np.random.default_rng(5).normal(size=(len(CHANNELS), columns, rows)).astype(np.float32)


@pytest.fixture
def own(torch, tmp_path):
    """Weights of a small network whose normalisations are no longer those of the beginning."""
    from slopewatch.models.network.unet import UNet, save_unet

    torch.manual_seed(3)
    network = UNet(UNetConfiguration(channels=CHANNELS[3:9], widths=(4, 6, 8)))
    for _ in range(3):
        network(torch.randn(2, 6, 16, 16) * 2.0 + 1.0)
    path = tmp_path / "relief.safetensors"
    save_unet(path, network.eval(), {}, {})
    return path


@pytest.mark.parametrize("shape", [(150, 91), (8, 200), (1, 30)])
def test_shipped_weights_give_what_torch_gives(torch, shape):
    from slopewatch.models.network.unet import load_unet

    channels = some_channels(*shape)
    expected = raster_logits(load_unet(*shipped_relief())[0], channels, tile=96)
    found = raster_logits(load_plain_unet(*shipped_relief())[0], channels, tile=96)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.ptp(expected) > 0.5


def test_other_widths_and_channels_give_what_torch_gives(own):
    from slopewatch.models.network.unet import load_unet

    channels = some_channels(64, 48)
    expected, found = (raster_logits(load(own)[0], channels) for load in (load_unet, load_plain_unet))
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.ptp(expected) > 0.1


def test_steps_between_levels_are_those_of_torch(torch):
    from torch.nn import functional

    values = some_channels(6, 10)
    tensor = torch.from_numpy(values)[None]
    np.testing.assert_array_equal(halved(values), functional.max_pool2d(tensor, 2)[0].numpy())
    twice = functional.interpolate(tensor, scale_factor=2.0, mode="bilinear", align_corners=False)[0].numpy()
    np.testing.assert_allclose(doubled(values), twice, atol=1e-6)


def test_weights_that_do_not_fit_are_refused(own):
    description = own.with_suffix(".json")
    stated = json.loads(description.read_text())
    for configuration in ({"widths": [4, 8, 8]}, {"widths": [4, 6]}, {"channels": list(CHANNELS[3:8])}):
        description.write_text(json.dumps(stated | {"configuration": stated["configuration"] | configuration}))
        with pytest.raises(InputError, match="do not fit"):
            load_plain_unet(own)
    description.write_text(json.dumps(stated | {"sha256": "0" * 64}))
    with pytest.raises(InputError, match="checksum"):
        load_plain_unet(own)
    description.write_text(json.dumps(stated))
    with pytest.raises(InputError, match="do not exist"):
        load_plain_unet(own.with_name("none.safetensors"))


def test_weights_that_are_no_numbers_are_refused(torch, own):
    from slopewatch.models.network.unet import load_unet, save_unet

    network = load_unet(own)[0]
    with torch.no_grad():
        network.head.bias[0] = float("nan")
    save_unet(own, network, {}, {})
    with pytest.raises(InputError, match="no number"):
        load_plain_unet(own)


def test_an_inspection_by_default_never_imports_torch():
    asked = (
        "import sys\n"
        "from slopewatch.interface.parameters import LastEpochParameters\n"
        "from slopewatch.workflows import inspect, last_epoch\n"
        "assert last_epoch.obstacle(LastEpochParameters()) is None\n"
        "from slopewatch.models.screening.method import learned_model\n"
        "from slopewatch.engine.core.progress import Progress\n"
        "from slopewatch.models.preparation.bump_filter import cell_heights\n"
        "import numpy as np\n"
        "xyz = np.random.default_rng(1).uniform(0, (40, 30, 0.1), (20_000, 3))\n"
        "model = learned_model(LastEpochParameters())\n"
        "cells = cell_heights(xyz, 0.5, np.zeros(2), (80, 60))\n"
        "assert np.isfinite(model.found(cells, Progress()).probabilities).all()\n"
        "sys.exit('torch' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("part", "value"), [("running_var", -1.0), ("running_mean", 3e38)])
def test_damaged_normalisations_are_refused_without_a_warning(own, tmp_path, part, value):
    """Warnings are errors in tests; on the terminal they would stand in front of the sentence."""
    from safetensors.numpy import load_file, save_file

    arrays = load_file(own)
    arrays[f"down.0.1.{part}"][:] = value
    arrays["down.0.1.weight"][:] = 1e3
    path = tmp_path / "damaged.safetensors"
    save_file(arrays, path)
    facts = json.loads(own.with_suffix(".json").read_text(encoding="utf-8"))
    facts["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    path.with_suffix(".json").write_text(json.dumps(facts), encoding="utf-8")
    with pytest.raises(InputError, match="damaged"):
        load_plain_unet(path)

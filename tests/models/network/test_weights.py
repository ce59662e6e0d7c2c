"""Weights on disk: back as they were, and refused when anything is wrong with them."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from slopewatch.engine.core.checksums import sha256
from slopewatch.engine.core.errors import InputError
from slopewatch.models.configuration import SMOKE


@pytest.fixture
def saved(torch, tmp_path):
    from slopewatch.models.network.randlanet import RandLANet
    from slopewatch.models.network.weights import save_model

    torch.manual_seed(1)
    network = RandLANet(SMOKE).eval()
    path = tmp_path / "model.safetensors"
    digest = save_model(path, network, {"steps": 3}, {"mean_iou": 0.5}, simulator_version=7)
    return path, network, digest


def test_weights_come_back_as_they_were(saved):
    from slopewatch.models.network.weights import load_model

    path, network, digest = saved
    model = load_model(path, digest)
    assert model.sha256 == digest == sha256(path)
    assert model.configuration == SMOKE
    assert model.metadata["metrics"] == {"mean_iou": 0.5}
    assert model.metadata["simulator_version"] == 7
    assert model.metadata["parameters"] == network.parameter_count
    for name, tensor in network.state_dict().items():
        np.testing.assert_array_equal(model.network.state_dict()[name], tensor)
    assert not model.network.training


def test_tampered_weights_are_refused(saved):
    from slopewatch.models.network.weights import load_model

    path, _, digest = saved
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="checksum"):
        load_model(path)
    # Whoever changes the description as well still meets the pinned checksum.
    description = json.loads(path.with_suffix(".json").read_text())
    description["sha256"] = sha256(path)
    path.with_suffix(".json").write_text(json.dumps(description))
    assert load_model(path).sha256 != digest
    with pytest.raises(InputError, match="checksum"):
        load_model(path, digest)


def test_pickles_are_refused_without_being_opened(saved, torch, tmp_path):
    from slopewatch.models.network.weights import load_model

    path, network, _ = saved
    torch.save(network.state_dict(), tmp_path / "model.pt")
    with pytest.raises(InputError, match="pickled"):
        load_model(tmp_path / "model.pt")
    # Under another name, too.
    path.write_bytes((tmp_path / "model.pt").read_bytes())
    assert zipfile.is_zipfile(path)
    with pytest.raises(InputError, match="pickled"):
        load_model(path)


def test_missing_or_foreign_files_are_named(saved, tmp_path):
    from slopewatch.models.network.weights import load_model, save_model

    path, network, _ = saved
    with pytest.raises(InputError, match="do not exist"):
        load_model(tmp_path / "none.safetensors")
    with pytest.raises(InputError, match=r"\.safetensors"):
        save_model(tmp_path / "model.pt", network, {}, {})
    description = path.with_suffix(".json")
    kept = description.read_text()
    description.write_text(kept.replace('"format": 1', '"format": 99'))
    with pytest.raises(InputError, match="another version"):
        load_model(path)
    changed = json.loads(kept)
    changed["configuration"]["widths"] = [8, 16]
    description.write_text(json.dumps(changed))
    with pytest.raises(InputError, match="do not fit"):
        load_model(path)
    description.write_text("{")
    with pytest.raises(InputError, match="cannot be read"):
        load_model(path)
    description.unlink()
    with pytest.raises(InputError, match="missing"):
        load_model(path)

"""What the screening of a file refuses, each with its remedy and without a file left behind."""

from __future__ import annotations

import sys
from pathlib import Path

import geopandas
import pytest
from slopewatch.engine.core.errors import EngineError, InputError
from slopewatch.interface.parameters import GroundParameters, InputParameters, ScreeningParameters
from slopewatch.models.screening import network
from slopewatch.tests.builders.screening_clouds import leftovers, screen, slope, small_weights, write
from slopewatch.workflows.products.screening import default_targets
from slopewatch.workflows.screen import screen_step
from slopewatch.workflows.settings import ScreeningSettings


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("slope") / "2024-05-01.laz", slope())


@pytest.fixture
def weights(tmp_path) -> Path:
    return small_weights(tmp_path / "model.safetensors")


def refused(tmp_path, cloud, match, error=InputError, **given):
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(error, match=match):
        screen(cloud, folder / "out.laz", method=given.pop("method", "network"), **given)
    assert list(folder.iterdir()) == []


def test_tampered_weights(cloud, weights, tmp_path):
    content = bytearray(weights.read_bytes())
    content[-1] ^= 1
    weights.write_bytes(content)
    refused(tmp_path, cloud, "checksum", weights=str(weights))


def test_a_pickled_model(cloud, weights, tmp_path):
    import torch

    torch.save({"a": torch.zeros(1)}, tmp_path / "model.pt")
    refused(tmp_path, cloud, "pickled models are not opened", weights=str(tmp_path / "model.pt"))


def test_no_weights(cloud, weights, tmp_path):
    refused(tmp_path, cloud, "do not exist", weights=str(tmp_path / "none.safetensors"))


@pytest.mark.parametrize(
    ("missing", "given"),
    [
        ("torch", {"method": "network"}),
        ("torch", {"method": "relief", "device": "gpu"}),
        ("torch", {"method": "auto", "device": "auto"}),
        ("safetensors", {"method": "auto"}),
    ],
)
def test_a_library_is_missing(cloud, tmp_path, monkeypatch, missing, given):
    monkeypatch.setitem(sys.modules, missing, None)
    sentence = rf"needs the Python library {missing}.*slopewatch\[screening\].*--screening-method filter"
    refused(tmp_path, cloud, sentence, **given)
    # without learning it is not needed
    screen(cloud, tmp_path / "residual.laz")


def test_no_graphics_card(cloud, weights, tmp_path, monkeypatch):
    import torch

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    refused(tmp_path, cloud, "no graphics card .* --device cpu", weights=str(weights), device="gpu")
    assert network.ScreeningModel(ScreeningParameters(weights=str(weights), device="auto")).device == torch.device(
        "cpu"
    )


@pytest.mark.parametrize("kind", ["memory", "processor", "card"])
@pytest.mark.parametrize("method", ["network", "relief"])
def test_memory_runs_out(cloud, weights, tmp_path, monkeypatch, kind, method):
    import torch

    failure = {
        "memory": MemoryError(),
        "processor": RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
        "card": torch.OutOfMemoryError("CUDA error"),
    }[kind]

    def forward(*_):
        raise failure

    monkeypatch.setattr("slopewatch.models.network.randlanet.RandLANet.forward", forward)
    monkeypatch.setattr("slopewatch.models.network.plain_unet.PlainUNet.answer", forward)
    own = {"weights": str(weights)} if method == "network" else {}
    refused(tmp_path, cloud, "Memory ran out while screening", EngineError, method=method, **own)


def test_other_failures_keep_their_words(cloud, weights, tmp_path, monkeypatch):
    def forward(*_):
        raise RuntimeError("shapes do not fit")

    monkeypatch.setattr("slopewatch.models.network.randlanet.RandLANet.forward", forward)
    refused(tmp_path, cloud, "shapes do not fit", RuntimeError, weights=str(weights))


def test_density_that_the_network_was_not_made_for(weights, tmp_path):
    sparse = write(tmp_path / "sparse.laz", slope(3000))
    refused(tmp_path, sparse, "made for 20 to 450", weights=str(weights))


def test_outputs_that_cannot_be(cloud, tmp_path):
    with pytest.raises(InputError, match="also an input"):
        screen(cloud, cloud)
    with pytest.raises(InputError, match=r"another ending than \.laz"):
        screen(cloud, tmp_path / "out.las")
    settings = ScreeningSettings(
        InputParameters(), GroundParameters(), ScreeningParameters(screening_method="residual")
    )
    targets = default_targets(tmp_path / "out.laz", zones=tmp_path / "out.shp")
    with pytest.raises(InputError, match=r"another ending than \.gpkg"):
        screen_step(cloud, targets, settings)
    with pytest.raises(InputError, match="does not exist"):
        screen(cloud, tmp_path / "nowhere" / "out.laz")
    assert leftovers(tmp_path) == []


def test_a_region_beside_the_cloud(cloud, tmp_path):
    roi = tmp_path / "roi.geojson"
    geopandas.GeoSeries.from_wkt(["POLYGON((0 0, 9 0, 9 9, 0 0))"], crs=32651).to_file(roi)
    refused(tmp_path, cloud, "lies outside of the cloud", method="residual", roi=roi)


def test_too_few_points(tmp_path):
    refused(tmp_path, write(tmp_path / "few.laz", slope(20)), "20 ground points", method="residual")


@pytest.mark.parametrize(("method", "name"), [("network", "SHIPPED_WEIGHTS"), ("auto", "RELIEF_WEIGHTS")])
def test_without_shipped_weights_the_remedy_is_named(cloud, tmp_path, monkeypatch, method, name):
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    monkeypatch.setattr(f"slopewatch.models.network.shipped.{name}", tmp_path / "slopewatch.safetensors")
    sentence = r"missing from this copy of SlopeWatch; .* --screening-method filter"
    refused(tmp_path, cloud, sentence, method=method)


def test_relief_weights_that_are_not_those_shipped(cloud, tmp_path, monkeypatch):
    pytest.importorskip("torch", reason="torch is not installed; install slopewatch[screening]")
    monkeypatch.setattr("slopewatch.models.network.shipped.RELIEF_SHA256", "0" * 64)
    refused(tmp_path, cloud, "not those their checksum names", method="relief")

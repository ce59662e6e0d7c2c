"""What ``slopewatch check`` tells of screening."""

from __future__ import annotations

from slopewatch.workflows import check


def test_the_shipped_weights_are_named_or_said_to_be_missing(monkeypatch, tmp_path):
    for kind, name in (("SHIPPED", "screening_weights"), ("RELIEF", "relief_weights")):
        weights = tmp_path / f"{kind}.safetensors"
        monkeypatch.setattr(check, f"{kind}_WEIGHTS", weights)
        monkeypatch.setattr(check, f"{kind}_SHA256", "0123456789abcdef")
        assert check.check_environment()[name] == "not there"
        weights.write_bytes(b"x")
        assert check.check_environment()[name] == "0123456789ab"

"""What ``slopewatch check`` tells of screening."""

from __future__ import annotations

from slopewatch.workflows import check


def test_the_shipped_weights_are_named_or_said_to_be_missing(monkeypatch, tmp_path):
    weights = tmp_path / "slopewatch.safetensors"
    monkeypatch.setattr(check, "SHIPPED_WEIGHTS", weights)
    monkeypatch.setattr(check, "SHIPPED_SHA256", "0123456789abcdef")
    assert check.check_environment()["screening_weights"] == "not there"
    weights.write_bytes(b"x")
    assert check.check_environment()["screening_weights"] == "0123456789ab"

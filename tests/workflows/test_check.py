"""What ``slopewatch check`` tells of screening."""

from __future__ import annotations

import importlib

import pytest
from slopewatch.engine.core.errors import InputError
from slopewatch.workflows import check


def hide(monkeypatch: pytest.MonkeyPatch, hidden: str) -> None:
    real = importlib.import_module

    def without(name: str, package: str | None = None) -> object:
        if name == hidden:
            raise ImportError(f"No module named {name!r}")
        return real(name, package)

    monkeypatch.setattr(check.importlib, "import_module", without)


@pytest.mark.parametrize("name", check.LIBRARIES)
def test_a_library_that_is_missing_is_named_with_the_remedy(monkeypatch, name):
    hide(monkeypatch, name)
    with pytest.raises(InputError, match=f"^The Python library {name} cannot be imported .*; set the engine up again"):
        check.check_environment()


@pytest.mark.parametrize("name", check.OPTIONAL)
def test_without_an_optional_one_it_says_what_that_means(monkeypatch, name):
    assert check.check_environment().get(name) != check.OPTIONAL[name]
    hide(monkeypatch, name)
    assert check.check_environment()[name] == check.OPTIONAL[name]


def test_the_shipped_weights_are_named_or_said_to_be_missing(monkeypatch, tmp_path):
    for kind, name in (("SHIPPED", "screening_weights"), ("RELIEF", "relief_weights")):
        weights = tmp_path / f"{kind}.safetensors"
        monkeypatch.setattr(check, f"{kind}_WEIGHTS", weights)
        monkeypatch.setattr(check, f"{kind}_SHA256", "0123456789abcdef")
        assert check.check_environment()[name] == "not there"
        weights.write_bytes(b"x")
        assert check.check_environment()[name] == "0123456789ab"

"""The names of enumerations before QGIS 3.36 mean the same as those after."""

from __future__ import annotations

import pytest
from slopewatch.plugin.bridge import compat


@pytest.mark.parametrize("name", sorted(compat._NAMES))
def test_both_spellings_agree(name: str) -> None:
    _, _, owner, old, member = compat._NAMES[name]
    before = compat._member("NotInThisQgis", "", owner, old, member)
    assert before == compat._member(*compat._NAMES[name]) == getattr(compat, name)

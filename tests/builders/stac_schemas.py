"""The JSON schemas of STAC's extensions, where there is a folder of them: they lie on the web; tests use no network.

``SLOPEWATCH_STAC_SCHEMAS`` names the folder. Its files ``*.json`` are taken by what they call themselves (``$id``).
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest


def extension_faults(document: dict[str, Any]) -> list[str]:
    """A sentence for each fault of an item by the schemas of the extensions that it names; a skip without these."""
    folder = os.environ.get("SLOPEWATCH_STAC_SCHEMAS", "")
    if not folder:
        pytest.skip("no schemas at hand: SLOPEWATCH_STAC_SCHEMAS names no folder of them")
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    from referencing import Registry
    from referencing.jsonschema import DRAFT7

    read = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(Path(folder).glob("*.json"))]
    schemas = {str(schema["$id"]).rstrip("#"): schema for schema in read}
    registry = Registry().with_resources([(name, DRAFT7.create_resource(schema)) for name, schema in schemas.items()])
    found = []
    for name in document["stac_extensions"]:
        assert name in schemas, f"{folder} has no schema {name}"
        checker = jsonschema.Draft7Validator(schemas[name], registry=registry)
        found += [f"{name}: {error.json_path}: {error.message[:300]}" for error in checker.iter_errors(document)]
    return found

"""The plugin's own settings, kept in the QGIS profile: where the engine's interpreter, its data and PDAL are."""

from __future__ import annotations

from qgis.core import QgsSettings

ENGINE_PYTHON = "slopewatch/engine_python"
PDAL = "slopewatch/pdal"
DATA_FOLDER = "slopewatch/data_folder"


def get(key: str) -> str:
    """The text stored under ``key``; empty if there is none."""
    return str(QgsSettings().value(key, "") or "").strip()


def store(key: str, value: str) -> None:
    """Keep ``value``; an empty one removes the setting."""
    value = value.strip()
    if value:
        QgsSettings().setValue(key, value)
    else:
        QgsSettings().remove(key)

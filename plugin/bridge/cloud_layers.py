"""Point clouds that are loaded in a project, as the files that the engine reads."""

from __future__ import annotations

from pathlib import Path

from qgis.core import QgsMapLayer, QgsPointCloudLayer, QgsProject

ENDINGS = (".las", ".laz")


def cloud_file(layer: QgsMapLayer | None) -> str:
    """The LAS or LAZ file of a point-cloud layer; empty where it is none, or of another kind (EPT, remote)."""
    if not isinstance(layer, QgsPointCloudLayer):
        return ""
    path = Path(layer.source().partition("|")[0])
    return str(path) if path.suffix.lower() in ENDINGS and path.is_file() else ""


def loaded_clouds(project: QgsProject) -> list[tuple[str, str]]:
    """Name and file of each point cloud that is loaded, by name."""
    found = [(layer.name(), cloud_file(layer)) for layer in project.mapLayers().values()]
    return sorted({(name, path) for name, path in found if path})


def resolved(value: str, project: QgsProject | None) -> str:
    """The file that ``value`` means: itself, or that of the point-cloud layer with this id or name."""
    if project is None or not value or Path(value).exists():
        return value
    named = [project.mapLayer(value), *project.mapLayersByName(value)]
    return next((path for path in map(cloud_file, named) if path), value)

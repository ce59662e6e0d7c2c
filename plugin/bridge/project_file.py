"""A QGIS project of a finished run: groups, styles, times, a print layout, and paths from its own place."""

from __future__ import annotations

import contextlib
import html
import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qgis.core import (
    Qgis,
    QgsCoordinateReferenceSystem,
    QgsDateTimeRange,
    QgsFillSymbol,
    QgsLayerTreeGroup,
    QgsLineSymbol,
    QgsMapLayer,
    QgsProject,
    QgsRasterLayer,
    QgsRectangle,
    QgsReferencedRectangle,
    QgsSingleSymbolRenderer,
    QgsUnitTypes,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDate, QDateTime, Qt, QTime

from .arrow_scale import named_with_scale
from .elevation_layers import surfaces
from .print_layout import Sheet, add_sheet
from .project_contents import EARLIER, LATER, SURVEYS, ZONES, Contents, Entry
from .translated_style import translate_style
from .words import tr

_LINES, _LINE_LOOK = "profiles", {"line_color": "20,20,20,255", "line_width": "0.4", "line_style": "dash"}
"""The layer of the profiles' lines, which has no style of its own, and how it is drawn."""
_REGIONS, _REGION_LOOK = "slopes", {"style": "no", "outline_color": "60,60,60,255", "outline_width": "0.4"}
"""The layer of a corridor's regions, which has none either: outlines, as they lie over the change."""
_SURVEY = "slopewatch/survey"
"""Property of a group in the layer tree: the day of its survey."""
_SIDE_FILES = "GDAL_PAM_ENABLED"
_MARGIN = 0.05
"""Of the first view, around the layers: a share of their size."""


class ProjectError(Exception):
    """The project cannot be made; the message says why in one sentence."""


@dataclass(frozen=True)
class Made:
    """How many layers the project has, and the name of its print layout."""

    layers: int
    layout: str


def write_project(contents: Contents, path: Path, sheet: Sheet) -> Made:
    """Write the project of a run.

    Raises:
        ProjectError: a layer cannot be opened, or the file cannot be written or is not the same when it is read.
    """
    with _no_side_files():
        return _made(contents, path, sheet)


@contextlib.contextmanager
def _no_side_files() -> Iterator[None]:
    """Without files of statistics (.aux.xml), which GDAL writes next to rasters that QGIS looks through."""
    before = os.environ.get(_SIDE_FILES)  # GDAL asks the environment each time
    os.environ[_SIDE_FILES] = "NO"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SIDE_FILES]
        else:
            os.environ[_SIDE_FILES] = before


def _made(contents: Contents, path: Path, sheet: Sheet) -> Made:
    project = QgsProject()
    project.setFilePathStorage(Qgis.FilePathType.Relative)
    project.setFileName(str(path))  # from here on layers are named from its folder
    layers = [(entry, layer) for entry in contents.entries for layer in _add(project, entry)]
    if not layers:
        raise ProjectError(f"{contents.folder} holds no layer with a place; give the folder of another run.")
    crs = next((layer.crs() for _, layer in layers if layer.crs().isValid()), QgsCoordinateReferenceSystem())
    project.setCrs(crs)
    project.setTitle(sheet.title)
    _set_times(project, contents, layers)
    extent = _extent([layer for _, layer in layers if layer.isSpatial()], crs)
    project.viewSettings().setDefaultViewExtent(QgsReferencedRectangle(extent, crs))
    zones = next((layer for entry, layer in layers if entry is contents.zones), None)
    shown = [layer for layer in project.layerTreeRoot().layerOrder() if _is_shown(project, layer)]
    name = add_sheet(project, sheet, extent, shown, zones)
    _write(project, path, len(layers))
    return Made(len(layers), name)


def _write(project: QgsProject, path: Path, count: int) -> None:
    """Under a temporary name first, so that a broken run leaves no half a project."""
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        project.setFileName(str(partial))
        written = project.write()
        if not written:
            raise ProjectError(f"{path} cannot be written ({project.error()}); choose another place.")
        _forget_place(partial, path.parent)
        read = QgsProject()
        if not read.read(str(partial)) or len(read.mapLayers()) != count or not _all_valid(read):
            raise ProjectError(f"{path} read back differs from what was written; choose another place.")
        read.clear()
        partial.replace(path)
    except OSError as error:
        raise ProjectError(f"{path} cannot be written ({error.strerror}); choose another place.") from None
    finally:
        partial.unlink(missing_ok=True)


def _forget_place(file: Path, folder: Path) -> None:
    """Take the folder out of the file: layouts note the whole path of their layers, which they find by their ids."""
    place = html.escape(folder.as_posix().rstrip("/"), quote=False) + "/"
    if file.suffix.lower() != ".qgz":
        text = file.read_text(encoding="utf-8")
        file.write_text(text.replace(place, "./"), encoding="utf-8")
        return
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            if name.endswith(".qgs"):
                content = content.decode("utf-8").replace(place, "./").encode("utf-8")
            archive.writestr(name, content)


def _all_valid(project: QgsProject) -> bool:
    return all(layer.isValid() for layer in project.mapLayers().values())


def _add(project: QgsProject, entry: Entry) -> list[QgsMapLayer]:
    """The entry's layers in their group, with the style of the run."""
    source = f"{entry.path}|layername={entry.layer}" if entry.layer else str(entry.path)
    title = tr(entry.title)
    layer: Any = QgsVectorLayer(source, title, "ogr") if entry.layer else QgsRasterLayer(source, title, "gdal")
    if not layer.isValid():
        if entry.layer:  # a GeoPackage without that layer
            return []
        raise ProjectError(f"{entry.path} cannot be opened as a layer; make the run again.")
    layer.loadDefaultStyle()
    if entry.layer == _LINES:
        layer.setRenderer(QgsSingleSymbolRenderer(QgsLineSymbol.createSimple(_LINE_LOOK)))
    if entry.layer == _REGIONS:
        layer.setRenderer(QgsSingleSymbolRenderer(QgsFillSymbol.createSimple(_REGION_LOOK)))
    translate_style(layer)
    layer.setName(named_with_scale(layer, title))
    layer.setCustomProperty("slopewatch/output", entry.path.name)
    group = _group(project, entry)
    project.addMapLayer(layer, False)
    node = group.addLayer(layer)
    node.setItemVisibilityChecked(entry.visible)
    node.setExpanded(entry.visible)
    if entry.bands:
        before = set(project.mapLayers())
        surfaces([tr(title) for title in entry.bands])(layer, project)
        of_bands = [layer, *(project.mapLayer(name) for name in set(project.mapLayers()) - before)]
        _move_to_surveys(project, entry, of_bands)
        return of_bands
    return [layer]


def _group(project: QgsProject, entry: Entry) -> QgsLayerTreeGroup:
    group = _child(project.layerTreeRoot(), tr(entry.group), expanded=entry.group in (ZONES, SURVEYS))
    if entry.slope:
        return _child(group, entry.slope, expanded=False)
    return _survey_group(group, entry.survey) if entry.survey else group


def _survey_group(parent: QgsLayerTreeGroup, survey: str) -> QgsLayerTreeGroup:
    """The group of a survey, the newest one at the top."""
    groups = [node for node in parent.children() if isinstance(node, QgsLayerTreeGroup)]
    for node in groups:
        if node.customProperty(_SURVEY) == survey:
            return node
    titles = {EARLIER: tr("Earlier survey"), LATER: tr("Later survey")}
    place = sum(str(node.customProperty(_SURVEY)) > survey for node in groups)  # "Later" is after "Earlier" too
    made = parent.insertGroup(place, titles.get(survey) or tr("Survey of {0}").format(survey))
    made.setCustomProperty(_SURVEY, survey)
    made.setExpanded(False)
    return made


def _move_to_surveys(project: QgsProject, entry: Entry, layers: list[Any]) -> None:
    """Put the layer of each band into the group of its survey."""
    parent = _group(project, entry)
    for title, survey in zip(entry.bands, entry.surveys):
        for layer in layers:
            node = parent.findLayer(layer.id())
            if layer.name() == tr(title) and node is not None:
                _survey_group(parent, survey).addChildNode(node.clone())
                node.parent().removeChildNode(node)


def _child(parent: QgsLayerTreeGroup, title: str, *, expanded: bool) -> QgsLayerTreeGroup:
    """The group of that title in ``parent`` itself: a slope may be called as a group elsewhere is."""
    for node in parent.children():
        if isinstance(node, QgsLayerTreeGroup) and node.name() == title:
            return node
    made = parent.addGroup(title)
    made.setExpanded(expanded)
    return made


def _set_times(project: QgsProject, contents: Contents, layers: list[tuple[Entry, Any]]) -> None:
    """What a layer shows is of the days after the one survey until the other; the project's time spans the surveys."""
    for entry, layer in layers:
        if entry.bands and entry.days:
            later = layer.name() == tr(entry.bands[-1])
            _fix_time(layer, entry.days[1] if later else entry.days[0], None if later else entry.days[1])
        elif entry.days:
            _fix_time(layer, *entry.days)
    if len(contents.days) < 2:
        return
    moments = [_midnight(day) for day in contents.days]
    times = project.timeSettings()
    times.setTemporalRange(QgsDateTimeRange(moments[0], moments[-1]))
    times.setTimeStepUnit(QgsUnitTypes.TemporalUnit.TemporalDays)
    times.setTimeStep(float(max(1, min(a.daysTo(b) for a, b in zip(moments, moments[1:])))))


def _fix_time(layer: Any, begin: str, end: str | None) -> None:
    properties = layer.temporalProperties()
    if properties.isActive():
        return  # the style has a time of its own
    last = _midnight(end) if end else QDateTime()
    properties.setFixedTemporalRange(QgsDateTimeRange(_midnight(begin), last, False, True))
    properties.setIsActive(True)


def _midnight(day: str) -> QDateTime:
    return QDateTime(QDate.fromString(day, Qt.DateFormat.ISODate), QTime(0, 0), Qt.TimeSpec.UTC)


def _extent(layers: list[Any], crs: QgsCoordinateReferenceSystem) -> QgsRectangle:
    """Of all layers of the project's own reference system, with a margin."""
    extent = QgsRectangle()
    for layer in layers:
        if layer.crs() == crs and not layer.extent().isEmpty():
            extent.combineExtentWith(layer.extent())
    extent.grow(_MARGIN * max(extent.width(), extent.height(), 1.0))
    return extent


def _is_shown(project: QgsProject, layer: QgsMapLayer) -> bool:
    node = project.layerTreeRoot().findLayer(layer.id())
    return node is not None and layer.isSpatial() and node.itemVisibilityChecked()

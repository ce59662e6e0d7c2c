"""Styled results: what is done to a layer once QGIS has loaded it.

The styles themselves are written by the engine (a .qml next to each raster, the style table in the GeoPackage), so
that they are there for qgis_process and other programs too.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingLayerPostProcessorInterface,
    QgsProject,
    QgsVectorFileWriter,
    QgsVectorLayer,
)

from .arrow_scale import named_with_scale
from .translated_style import translate_style
from .words import tr


@dataclass(frozen=True)
class Appearance:
    """How a result sits in the layer tree: ``order`` (larger is higher), shown at first, legend unfolded.

    ``after`` is called with the styled layer and its project, in QGIS's main thread.
    """

    order: int
    visible: bool = True
    expanded: bool = True
    after: Callable[[Any, QgsProject], None] | None = None


class StylePostProcessor(QgsProcessingLayerPostProcessorInterface):
    """Applies the engine's style, visibility and unfolding to a layer that has just been loaded."""

    # QGIS does not take ownership: a post-processor that Python has collected silently never runs.
    _kept: ClassVar[list[StylePostProcessor]] = []

    def __init__(self, appearance: Appearance, name: str = "") -> None:
        super().__init__()
        self._appearance, self._name = appearance, name

    @classmethod
    def create(cls, appearance: Appearance, name: str = "") -> StylePostProcessor:
        """``name``: of the layer, to which the scale of its arrows is added; empty where people chose one."""
        instance = cls(appearance, name)
        cls._kept.append(instance)
        del cls._kept[:-200]
        return instance

    def postProcessLayer(self, layer: Any, context: Any, feedback: Any) -> None:
        # Processing loads layers without their default style: the .qml next to a raster, the one inside a GeoPackage.
        message, loaded = layer.loadDefaultStyle()
        if message and not loaded:
            feedback.pushWarning(tr(f"The style of {layer.source()} could not be applied: {message}"))
        translate_style(layer)
        if self._name:
            layer.setName(named_with_scale(layer, self._name))
        layer.triggerRepaint()
        project = context.project() or QgsProject.instance()
        node = project.layerTreeRoot().findLayer(layer.id())
        if node is not None:
            node.setItemVisibilityChecked(self._appearance.visible)
            node.setExpanded(self._appearance.expanded)
        if self._appearance.after is not None:
            self._appearance.after(layer, project)


def style_on_completion(
    context: QgsProcessingContext,
    registered: str,
    path: str,
    appearance: Appearance,
    name: str,
    group: str,
) -> None:
    """Have the layer that was to be loaded from ``registered`` loaded from ``path`` instead, named and styled.

    Does nothing where the layer is not going to be loaded. ``name`` and ``group`` are kept out where they are empty.
    """
    if not registered or not context.willLoadLayerOnCompletion(registered):
        return
    known = context.layerToLoadOnCompletionDetails(registered)
    # A fresh object: the known one is a reference into the context, which is replaced below.
    details = QgsProcessingContext.LayerDetails(
        tr(name) or known.name, known.project, known.outputName, known.layerTypeHint
    )
    details.forceName = bool(name) or known.forceName
    details.groupName = tr(group) or known.groupName
    details.layerSortKey = appearance.order
    details.setPostProcessor(StylePostProcessor.create(appearance, tr(name)))
    layers = {p: d for p, d in context.layersToLoadOnCompletion().items() if p != registered}
    layers[path] = details
    context.setLayersToLoadOnCompletion(layers)


def leave_unloaded(context: QgsProcessingContext, registered: str) -> None:
    """Have a layer that was to be loaded not loaded."""
    layers = {p: d for p, d in context.layersToLoadOnCompletion().items() if p != registered}
    context.setLayersToLoadOnCompletion(layers)


def load_on_completion(context: QgsProcessingContext, path: str, appearance: Appearance, name: str, group: str) -> None:
    """Have a file that is no declared output loaded as a layer of the project, named, grouped and styled."""
    shown = tr(name)
    details = QgsProcessingContext.LayerDetails(shown, context.project() or QgsProject.instance(), shown)
    details.forceName = True
    details.groupName = tr(group)
    details.layerSortKey = appearance.order
    details.setPostProcessor(StylePostProcessor.create(appearance))
    context.addLayerToLoadOnCompletion(path, details)


def copy_raster(source: str, target: str) -> None:
    """Copy a raster with the style next to it."""
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    style = Path(source).with_suffix(".qml")
    if style.is_file():
        shutil.copyfile(style, Path(target).with_suffix(".qml"))


def copy_vector(source: str, target: str, layer_name: str, context: QgsProcessingContext) -> None:
    """Copy a GeoPackage with its styles; for another format, convert its layer and write the style next to it.

    Raises:
        OSError: the target cannot be written.
    """
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    if Path(target).suffix.lower() == ".gpkg":
        shutil.copyfile(source, target)
        return
    layer = QgsVectorLayer(f"{source}|layername={layer_name}", layer_name, "ogr")
    options = QgsVectorFileWriter.SaveVectorOptions()
    options.driverName = QgsVectorFileWriter.driverForExtension(Path(target).suffix)
    options.layerName = Path(target).stem
    written = QgsVectorFileWriter.writeAsVectorFormatV3(layer, target, context.transformContext(), options)
    if written[0] != QgsVectorFileWriter.WriterError.NoError:
        raise OSError(written[1])
    layer.saveNamedStyle(str(Path(target).with_suffix(".qml")))


def is_point_cloud_layer_possible() -> bool:
    """Whether this QGIS was built with the provider that opens LAS and LAZ files."""
    from qgis.core import QgsProviderRegistry

    return "pdal" in QgsProviderRegistry.instance().providerList()

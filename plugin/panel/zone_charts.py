"""The section of a zone, its time series and its alert level, under tabs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from qgis.core import QgsVectorLayer
from qgis.PyQt.QtWidgets import QTabWidget

from ..bridge.words import tr
from .alerts import AlertView, history_of, level_colours
from .charts import CourseChart, SectionChart
from .courses import Course, course_of
from .run_folder import run_folder
from .sampled_section import sampled_section
from .section_vectors import line_of, vectors_near
from .sections import Section, sections_of
from .zone_rows import ZoneRow


class ZoneCharts(QTabWidget):
    """Shows what the run of a zone has about it."""

    def __init__(self, parent: Any = None) -> None:
        super().__init__(parent)
        self.section, self.course, self.alert = SectionChart(), CourseChart(), AlertView()
        self.addTab(self.section, tr("Section"))
        self.addTab(self.course, tr("Time series"))
        self.addTab(self.alert, tr("Alert level"))
        self._shown: tuple[str, int] | None = None
        self.clear()

    def clear(self) -> None:
        self._shown = None
        for chart in (self.section, self.course, self.alert):
            chart.say(tr("Choose a zone in the list or on the map."))

    def show_zone(self, layer: QgsVectorLayer, row: ZoneRow) -> None:
        """Draw the zone's section and series; nothing is read again for the zone that is shown already."""
        if self._shown == (layer.id(), row.feature):
            return
        self._shown = layer.id(), row.feature
        folder = run_folder(layer.source())
        if row.alert is None:
            self.alert.say(tr("Alert levels are those of a series."))
        else:
            self.alert.show_alert(row.alert, "", ())
        if folder is None:
            for chart in (self.section, self.course):
                chart.say(tr("The layer does not lie in the output folder of a run, so that no section is known."))
            return
        try:
            section, course = section_of(folder, layer, row), course_of(folder, row.name)
            history = history_of(folder, row.name)
        except (OSError, ValueError) as error:
            for chart in (self.section, self.course):
                chart.say(str(error))
            return
        self._draw(section, course)
        if row.alert is not None:
            self.alert.show_alert(row.alert, level_colours(folder).get(row.alert.level, ""), history)

    def _draw(self, section: Section | None, course: Course | None) -> None:
        if section is None:
            self.section.say(tr("The run has no raster of the change, so that no section can be drawn."))
        else:
            self.section.show_section(section)
        if course is None:
            self.course.say(tr("The run compares two surveys. A time series is that of Inspect series."))
        else:
            self.course.show_course(course)
        self.setCurrentWidget(self.section if course is None else self.course)


def section_of(folder: Path, layer: QgsVectorLayer, row: ZoneRow) -> Section | None:
    """The section of a zone from the run's table, else from its rasters, with the displacement vectors near it.

    Raises:
        ValueError, OSError: as of ``sections.sections_of``.
    """
    known = sections_of(folder, row.name)
    if known:
        line = line_of(folder, known[0].name)
        return known[0] if line is None else replace(known[0], vectors=vectors_near(folder, *line))
    return sampled_section(folder, row.name, layer.getFeature(row.feature).geometry(), layer.crs())

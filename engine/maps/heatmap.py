"""The heatmap as an annotated PNG."""

from __future__ import annotations

from pathlib import Path

import geopandas as gpd

from ..core.progress import Progress
from ..core.staged_outputs import atomic_output
from .heatmap_image import Heatmap


def write_heatmap_png(
    path: Path,
    heatmap: Heatmap,
    *,
    progress: Progress | None = None,
    zones: gpd.GeoDataFrame | None = None,
    epochs: tuple[str, str] = ("", ""),
    name: str = "",
) -> None:
    """Write the heatmap as an annotated PNG: zone outlines and ids, legend, scale bar, north arrow, coordinates.

    Args:
        progress: gets a line where the words stay English for want of a font.
        zones: as of ``extraction.extract_zones``, in the heatmap's horizontal reference system, most severe first.

    Raises:
        InputError: the folder is missing or not writable.
    """
    # matplotlib takes half a second to import; nothing else of the engine should wait for it
    from .figure import DPI, check_png, make_figure
    from .map_parts import PNG_OPTIONS
    from .picture_words import say_missing_font

    say_missing_font(progress)
    with atomic_output(Path(path), check_png) as partial:
        figure = make_figure(heatmap, zones=zones, epochs=epochs, name=name)
        software = {"Software": "SlopeWatch"}
        figure.savefig(partial, format="png", dpi=DPI, metadata=software, pil_kwargs=PNG_OPTIONS)

"""``slopewatch exportlabelstudio`` and ``importlabelstudio``: a top view to Label Studio, and the labels back."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import shapely

from ..engine.core.errors import InputError
from ..engine.core.json_values import plain
from ..engine.core.progress import Progress
from ..engine.core.run_result import RunResult
from ..engine.core.staged_outputs import refuse_unwritable
from ..engine.core.version import VERSION
from ..engine.grid.grid import Grid
from ..engine.maps.label_pngs import PictureSource, write_png
from ..engine.maps.qgis_styles import drawn_qml
from ..engine.vector.drawn_segments import label_layer, percent, refuse_off_the_cloud, without_holes
from ..engine.vector.geopackage import Layer, write_layers
from ..engine.vector.given_segments import Segment, read_segments
from ..engine.vector.label_pictures import PLACE, LabelPicture, read_pictures
from ..engine.vector.label_regions import read_regions
from ..interface.parameters import LabellingParameters, OutputParameters
from .run import Run, record_name_of

LABELLING_OUTPUTS = ("tasks.json", "labels.xml")
_COLOURS = {"uplift": "#2166ac", "subsidence": "#d6302a", "background": "#4d9221", "unknown": "#7f7f7f"}
_MORE_COLOURS = ("#e08214", "#8073ac", "#35978f", "#dd3497", "#a6761d")
_CONTROLS = ("Polygon", "Rectangle", "Brush")


def export_step(
    picture: Path,
    output_dir: Path,
    parameters: LabellingParameters,
    *,
    segments: Path | None = None,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """Pictures with world files, tasks and a labelling configuration for Label Studio.

    Args:
        picture: a raster of a top view.
        segments: polygons that are shown on the pictures as predictions, with their attributes.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    inputs = [("picture", picture), ("segments", segments)]
    run = Run("exportlabelstudio", {"labelling": parameters}, inputs, progress)
    run.refuse_folder(output_dir, ("run.json", *LABELLING_OUTPUTS), overwrite=overwrite)
    labels = _labels(parameters)
    run.hash_inputs()
    with PictureSource(picture) as source:
        given = [] if segments is None else read_segments(segments, parameters.label_field, source.crs, progress)
        labels += [label for label in dict.fromkeys(s.label for s in given) if label and label not in labels]
        with run.writing(output_dir) as stage, run.step("pictures", 0.0, 1.0, "writing pictures"):
            tasks: list[dict[str, Any]] = []
            for ending, grid, rgba in source.tiles(parameters.largest_picture):
                name = f"{picture.stem}{ending}.png"
                digest = write_png(stage.path(name), rgba, grid, source.crs)
                shown, regions = _predictions(given, grid)
                known = LabelPicture(name, grid, source.crs, digest, stage.folder, shown)
                tasks.append(_task(known, regions, parameters))
                run.outputs[f"picture_{len(tasks)}"] = stage.final(name)
            if not tasks:
                raise InputError(f"{picture} shows nothing; give a raster in which something was measured.")
            _write_json(stage.path("tasks.json"), tasks)
            stage.path("labels.xml").write_text(_configuration(labels), encoding="utf-8")
            run.outputs |= {"tasks": stage.final("tasks.json"), "labels": stage.final("labels.xml")}
            count = sum(len(task["data"][PLACE]["segments"]) for task in tasks)
            run.figures = {"pictures": len(tasks), "segments": len(given), "regions": count, "labels": len(labels)}
    return run.result()


def import_step(
    export: Path,
    tasks: Path,
    output: Path,
    *,
    overwrite: bool = False,
    progress: Progress,
) -> RunResult:
    """The regions of a JSON export of Label Studio as a georeferenced layer.

    Args:
        tasks: the tasks.json that ``export_step`` wrote, with its pictures next to it.

    Raises:
        InputError: something given cannot be used; nothing is written then.
    """
    if output.suffix.lower() != ".gpkg":
        raise InputError(f"The output {output} is to be a GeoPackage; end its name in .gpkg.")
    refuse_unwritable(output)
    chosen = {"outputs": OutputParameters(overwrite=overwrite)}
    run = Run("importlabelstudio", chosen, [("export", export), ("tasks", tasks)], progress)
    record = record_name_of(output)
    run.refuse_folder(output.absolute().parent, (output.name, record), overwrite=overwrite)
    pictures = read_pictures(tasks)
    run.hash_inputs()
    with run.step("read", 0.0, 0.6, "reading regions"):
        regions, notes = read_regions(export, pictures)
        refuse_off_the_cloud(regions, pictures)
    for sentence in notes:
        progress.warning(sentence)
    frame = label_layer(regions, pictures, next(iter(pictures.values())).crs)
    with run.writing(output.absolute().parent, record_name=record) as stage, run.step("write", 0.6, 1.0, "writing"):
        write_layers(stage.path(output.name), [Layer(frame, "labels", drawn_qml("class"), "MultiPolygon")])
        run.outputs["labels"] = stage.final(output.name)
        run.figures = {
            "regions": len(regions),
            "polygons": len(frame),
            "area_m2": float(frame["area_m2"].sum()),
            "tasks": len({region.task_id for region in regions}),
            "labels": plain(frame["class"].value_counts().to_dict()),
        }
    return run.result()


def _labels(parameters: LabellingParameters) -> list[str]:
    labels = list(dict.fromkeys(filter(None, (name.strip() for name in parameters.labels.split(",")))))
    if not labels:
        raise InputError("labels is empty; give names separated by commas, such as uplift,subsidence.")
    return labels


def _predictions(given: Sequence[Segment], grid: Grid) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the task file keeps of the segments on a picture, by region, and the regions as Label Studio reads them."""
    frame = shapely.box(*grid.bounds)
    kept: dict[str, Any] = {}
    results = []
    for segment in given:
        pieces = without_holes(shapely.intersection(segment.shape, frame))
        for number, piece in enumerate(pieces, 1):
            region = segment.name if len(pieces) == 1 else f"{segment.name}-{number}"
            kept[region] = {"segment": segment.name, "attributes": segment.attributes}
            said = "; ".join(f"{name}: {value}" for name, value in segment.attributes.items())
            results.append(
                {
                    "id": region,
                    "type": "polygonlabels",
                    "from_name": "polygon",
                    "to_name": "picture",
                    "original_width": grid.columns,
                    "original_height": grid.rows,
                    "image_rotation": 0,
                    "value": {
                        "points": percent(piece, grid),
                        "closed": True,
                        "polygonlabels": [segment.label] if segment.label else [],
                    },
                    "meta": {"text": [said]},
                }
            )
    return kept, results


def _task(picture: LabelPicture, regions: list[dict[str, Any]], parameters: LabellingParameters) -> dict[str, Any]:
    task: dict[str, Any] = {"data": {"image": parameters.picture_address + picture.name, PLACE: picture.facts()}}
    if regions:
        task["predictions"] = [{"model_version": f"SlopeWatch {VERSION}", "result": regions}]
    return task


def _configuration(labels: Sequence[str]) -> str:
    """The labelling interface of the project in Label Studio."""
    more = iter(_MORE_COLOURS * (1 + len(labels) // len(_MORE_COLOURS)))
    lines = [
        f"    <Label value={quoteattr(label)} background={quoteattr(_COLOURS.get(label) or next(more))}/>"
        for label in labels
    ]
    blocks = [
        "\n".join([f'  <{kind}Labels name="{kind.lower()}" toName="picture">', *lines, f"  </{kind}Labels>"])
        for kind in _CONTROLS
    ]
    return "\n".join(
        [
            "<View>",
            '  <Image name="picture" value="$image" zoom="true" zoomControl="true"/>',
            *blocks,
            '  <TextArea name="remark" toName="picture" perRegion="true" editable="true" placeholder="Remark"/>',
            "</View>",
            "",
        ]
    )


def _write_json(path: Path, document: Any) -> None:
    path.write_text(json.dumps(plain(document), ensure_ascii=False, indent=1, allow_nan=False) + "\n", encoding="utf-8")

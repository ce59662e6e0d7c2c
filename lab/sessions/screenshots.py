#!/usr/bin/env python3
"""Pictures of the plugin at work, for docs/images: a real QGIS on a display in memory (Xvfb).

``lab/sessions/screenshots.py`` simulates two surveys, runs Inspect slope from its dialog and keeps the pictures;
``lab/sessions/screenshots.py screening`` simulates one and screens it, ``panel`` takes the panel's picture,
``dialogs FOLDER`` every dialog as it opens and with all its boxes open, to be looked at. ``setup`` starts QGIS with the
plugin's zip of the last commit and no engine, and sets it up from the network. ``tutorial`` follows docs/tutorial.md,
and says which of its figures are no longer those of the run. ``motion`` shows motion along the surface. The tests of
the desktop use ``run_session`` with small surveys, and with an index of tiny wheels.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
START = 90.0  # seconds that QGIS may take to start
SCREEN = "1600x1000x24"
PANEL_SCREEN = "1500x1050x24"
TUTORIAL_SCREEN = "1300x940x24"
KEPT = ("desktop", "dialog", "zones")
TUTORIAL_SURVEY = {"POINTS": 400_000}  # what the tutorial's reader sets
SCREENING_KEPT = {"dialog": "screening_dialog", "layers": "screening_layers"}


def private_profile(folder: Path, plugin: Path | None = ROOT, language: str = "") -> dict[str, str]:
    """A QGIS profile with the plugin linked and switched on; gives the environment for QGIS programs.

    Args:
        plugin: its folder; None for a QGIS without it.
        language: of QGIS's interface, such as zh-Hans; by default English.
    """
    plugins = folder / "profiles" / "default" / "python" / "plugins"
    plugins.mkdir(parents=True)
    if plugin is not None:
        (plugins / "slopewatch").symlink_to(plugin)
    settings = folder / "profiles" / "default" / "QGIS" / "QGIS3.ini"
    settings.parent.mkdir(parents=True)
    settings.write_text(
        f"[PythonPlugins]\n{'' if plugin is None else 'slopewatch=true'}\nprocessing=true\n\n"
        "[qgis]\ncheckVersion=false\nshowTips=false\nnewsFeed\\enabled=false\n\n"
        "[app]\nprojections\\unknownCrsBehavior=NoAction\n\n"
        "[core]\nnewsFeed\\httpsfeedqgisorg\\disabled=true\n\n"
        + (f"[locale]\noverrideFlag=true\nuserLocale={language}\n" if language else ""),
        encoding="utf-8",
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY")}
    environment.update(
        # QGIS finds its Python's libraries by the first python3 on the path, which must be the system's
        PATH=os.pathsep.join(["/usr/bin", "/bin", environment.get("PATH", "")]),
        QGIS_CUSTOM_CONFIG_PATH=str(folder),
        QGIS_PLUGINPATH=str(plugins),
        XDG_RUNTIME_DIR=str(folder),
        QT_QPA_PLATFORM="xcb",
        LIBGL_ALWAYS_SOFTWARE="1",
        LANG="C.UTF-8",
    )
    folder.chmod(0o700)
    return environment


def run_session(
    parameters: dict[str, Any],
    folder: Path,
    *,
    script: str = "desktop_session.py",
    seconds: float = 300.0,
    screen: str = SCREEN,
    plugin: Path | None = ROOT,
    variables: dict[str, str] | None = None,
    language: str = "",
) -> dict[str, Any]:
    """Run a session of this folder in a real QGIS; gives its report. Pictures lie in ``folder / "images"``.

    Args:
        plugin: the folder of the plugin, which has ``lab``, too; None for a QGIS without it.
        variables: of QGIS's environment, in addition.
        language: of QGIS's interface.

    Raises:
        RuntimeError: QGIS ended without a report; the message has its last words.
    """
    images, report, task = folder / "images", folder / "report.json", folder / "task.json"
    images.mkdir(parents=True, exist_ok=True)
    task.write_text(
        json.dumps(
            {
                "parameters": {k: str(v) for k, v in parameters.items()},
                "images": str(images),
                "report": str(report),
                "seconds": seconds,
            }
        ),
        encoding="utf-8",
    )
    environment = {**private_profile(folder / "profile", plugin, language), **(variables or {})}
    environment["SLOPEWATCH_DESKTOP"] = str(task)
    session = str(ROOT / "lab" / "sessions" / script)
    if plugin is None:  # the session's own module is not to be had from the plugin
        environment["PYTHONPATH"] = str(folder / "modules")
        (folder / "modules").mkdir()
        shutil.copy(ROOT / "lab" / "sessions" / "qgis_session.py", folder / "modules")
    words_file = folder / "words.txt"
    process = subprocess.Popen(
        ["xvfb-run", "-a", "-s", f"-screen 0 {screen}", "qgis", "--nologo", "--noversioncheck", "--code", session],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=words_file.open("wb"),
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    started = time.monotonic()
    try:
        # a QGIS that does not run the session shows a dialog for ever
        while process.poll() is None and time.monotonic() - started < (seconds + 60 if report.exists() else START):
            time.sleep(0.2)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    text = report.read_text(encoding="utf-8") if report.exists() else ""
    if not text:
        words = words_file.read_text(encoding="utf-8", errors="replace")[-3000:]
        raise RuntimeError(f"QGIS ended with {process.returncode} and without a report:\n{words}")
    return json.loads(text)


_SHRINK = """
import io, sys
import numpy
from PIL import Image
picture = Image.open(sys.argv[1]).convert("RGB")
file = io.BytesIO()
picture.save(file, "PNG", optimize=True)
if file.tell() <= int(sys.argv[3]):  # as it is
    open(sys.argv[2], "wb").write(file.getvalue())
    sys.exit()
# 256 colours, as noise of the clouds is most of what a PNG has to keep; those of windows and legends stay as they are
pixels = numpy.asarray(picture)
even = (pixels[:, 1:] == pixels[:, :-1]).all(axis=2)
even = numpy.lib.stride_tricks.sliding_window_view(even, 9, axis=1).all(axis=2)
colours, counts = numpy.unique(pixels[:, : even.shape[1]][even], axis=0, return_counts=True)
flat = colours[numpy.argsort(-counts, kind="stable")][:128]
rest = picture.quantize(256 - len(flat), dither=Image.Dither.NONE).getpalette()[: 3 * (256 - len(flat))]
palette = Image.new("P", (1, 1))
palette.putpalette([*flat.ravel().tolist(), *rest])
width = picture.width
while True:
    small = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
    small = small.quantize(palette=palette, dither=Image.Dither.NONE)
    file = io.BytesIO()
    small.save(file, "PNG", optimize=True)
    if file.tell() <= int(sys.argv[3]):
        break
    width = width * 15 // 16
open(sys.argv[2], "wb").write(file.getvalue())
"""


def shrink(source: Path, target: Path, size: int = 290_000) -> None:
    """Write the picture as a PNG of at most ``size`` bytes: as it is, else in 256 colours, then with fewer pixels."""
    target.parent.mkdir(parents=True, exist_ok=True)
    python = str(ROOT / ".venv" / "bin" / "python")
    subprocess.run([python, "-c", _SHRINK, str(source), str(target), str(size)], check=True)


ENGINE = [str(ROOT / ".venv" / "bin" / "python"), "-m", "slopewatch.cli"]


def inspection(target: Path, folder: Path) -> None:
    """Inspect slope on two simulated surveys."""
    survey = folder / "survey"
    subprocess.run([*ENGINE, "simulate", "survey", "--output-dir", str(survey)], check=True)
    parameters = {
        "REFERENCE": survey / "2024-05-01.laz",
        "CLOUD": survey / "2025-05-01.laz",
        "ROI": survey / "roi.gpkg",
        "OUTPUT_FOLDER": folder / "results",
    }
    checked(run_session(parameters, folder, seconds=540))
    pictures = [*(folder / "images" / f"{name}.png" for name in KEPT), folder / "results" / "heatmap.png"]
    for picture in pictures:
        keep(picture, target / picture.name)


def screening(target: Path, folder: Path, cloud: Path | None = None, choices: dict[str, str] | None = None) -> None:
    """Screen for hazards on a simulated scene; or on ``cloud``, whose pictures are all kept, as they are."""
    if cloud is None:
        size = ["--kind", "realistic", "--count", "1", "--area", "2500", "--density", "60"]
        subprocess.run([*ENGINE, "simulate", "scenes", *size, "--output-dir", str(folder)], check=True)
        scene = next(folder.glob("realistic_*.laz"))
    else:
        scene = cloud.resolve()
    parameters = {"INPUT": scene, "OUTPUT": folder / "screened.laz", **(choices or {})}
    report = checked(run_session(parameters, folder, script="screening_session.py", seconds=540))
    print(report["log"])
    print(f"{report['seconds']:.1f} s from Run to the result")
    if cloud is None:
        for name, kept in SCREENING_KEPT.items():
            keep(folder / "images" / f"{name}.png", target / f"{kept}.png")
    else:
        shutil.copytree(folder / "images", target, dirs_exist_ok=True)


def dialogs(target: Path, folder: Path, language: str = "", wanted: str = "", values: Path | None = None) -> None:
    """Every dialog of the toolbox, or those that are wanted, as it opens and with all boxes open; then as it runs.

    Args:
        values: a JSON file of what is filled in before the run, by the names of the algorithms that are run.
    """
    given = {"ALGORITHMS": wanted, "VALUES": values.resolve() if values else ""}
    screen, script = "1600x2400x24", "dialogs_session.py"
    report = run_session(given, folder, script=script, screen=screen, language=language, seconds=1500)
    (folder / "images" / "logs.txt").write_text("\n\n".join(report.get("logs", {}).values()), encoding="utf-8")
    print(*(f"{name}: {seconds:.1f} s" for name, seconds in report.get("computing", {}).items()), sep="\n")
    shutil.copytree(folder / "images", target, dirs_exist_ok=True)
    print(*sorted(path.name for path in target.glob("*.png")), sep="\n")
    checked(report)


def setup(target: Path, folder: Path) -> None:
    """The set-up of the engine from the network, by the zip's plugin."""
    plugin, archive = folder / "zip" / "slopewatch", folder / "plugin.zip"
    subprocess.run(["bash", str(ROOT / "scripts" / "package.sh"), str(archive)], check=True)
    shutil.unpack_archive(archive, folder / "zip")
    (plugin / "lab").symlink_to(ROOT / "lab")
    variables = {"SLOPEWATCH_DATA": str(folder / "data")}
    report = checked(
        run_session(
            {"PICTURE_AT": "40"}, folder, script="setup_session.py", seconds=900, plugin=plugin, variables=variables
        )
    )
    print(report["log"])
    for name in ("setup_message", "setup_dialog"):
        keep(folder / "images" / f"{name}.png", target / f"{name}.png")


def panel(target: Path, folder: Path) -> None:
    """The panel with the zones of two simulated surveys and with those of a series."""
    surveys = folder / "survey"
    subprocess.run([*ENGINE, "simulate", "survey", "--points", "400000", "--output-dir", str(surveys)], check=True)
    epochs = [part for path in sorted(surveys.glob("20*.laz")) for part in ("--epoch", f"{path.stem}={path}")]
    options = ["--roi", str(surveys / "roi.gpkg"), "--output-dir", str(folder / "results")]
    subprocess.run([*ENGINE, "inspect", *epochs, *options], check=True)
    size = ["--points", "60000", "--length", "20", "--height", "8"]
    subprocess.run([*ENGINE, "simulate", "series", *size, "--output-dir", str(folder / "surveys")], check=True)
    options = ["--roi", str(folder / "surveys" / "roi.gpkg"), "--output-dir", str(folder / "series")]
    subprocess.run([*ENGINE, "series", str(folder / "surveys" / "surveys.csv"), *options], check=True)
    parameters = {"RUN": folder / "results", "SERIES": folder / "series"}
    checked(run_session(parameters, folder, script="panel_session.py", screen=PANEL_SCREEN))
    keep(folder / "images" / "panel.png", target / "panel.png")


def motion(target: Path, folder: Path, run: Path | None = None) -> None:
    """Motion along the surface of a simulated slope, as the plugin shows it; or that of ``run``, an output folder,
    whose pictures are all kept, as they are.
    """
    if run is None:
        survey = folder / "survey"
        made = ["--motion", "all", "--motion-amount", "0.2", "--points", "600000", "--output-dir", str(survey)]
        subprocess.run([*ENGINE, "simulate", "survey", *made], check=True)
        epochs = [part for path in sorted(survey.glob("20*.laz")) for part in ("--epoch", f"{path.stem}={path}")]
        options = ["--movement", "--roi", str(survey / "roi.gpkg"), "--output-dir", str(folder / "results")]
        subprocess.run([*ENGINE, "inspect", *epochs, *options], check=True)
    parameters = {"RUN": run.resolve() if run else folder / "results", "PREFIX": ""}
    checked(run_session(parameters, folder, script="motion_session.py", screen=TUTORIAL_SCREEN))
    if run is None:
        keep(folder / "images" / "with_displacement.png", target / "displacement.png", 290_000)
    else:
        shutil.copytree(folder / "images", target, dirs_exist_ok=True)


def tutorial(target: Path, folder: Path) -> None:
    """The tutorial's steps, from the zip of the last commit on; fails where the page says other figures."""
    archive = folder / "slopewatch.zip"
    subprocess.run(["bash", str(ROOT / "scripts" / "package.sh"), str(archive)], check=True)
    parameters = {"FOLDER": folder / "tutorial", "ZIP": archive, **TUTORIAL_SURVEY}
    variables = {"SLOPEWATCH_DATA": str(folder / "data"), "SLOPEWATCH_PYTHON": ""}
    report = checked(
        run_session(
            parameters, folder, script="tutorial_session.py", screen=TUTORIAL_SCREEN, seconds=1500, plugin=None,
            variables=variables,
        )
    )  # fmt: skip
    for picture in sorted((folder / "images").glob("tutorial_*.png")):
        keep(picture, target / picture.name, 250_000)
    print(f"{report['minutes']:.1f} minutes from step 2 on, clicked without reading; {report['panel_says']}")
    print(*(f"{name}: {seconds:.0f} s of computing" for name, seconds in report["computing"].items()), sep="\n")
    missing = not_on_the_page(report, (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))
    if missing:
        raise RuntimeError("docs/tutorial.md does not say what the run says:\n" + "\n".join(missing))


def not_on_the_page(report: dict[str, Any], page: str) -> list[str]:
    """What the inspection said in the end, and the rows of its zones, as far as the tutorial lacks them."""
    words = " ".join(re.sub("^> ", "", page, flags=re.M).split())
    said = [line.strip() for line in report["logs"]["inspectslope"].splitlines()]
    sentences = [line for line in said if re.search(r"^\d+ zones? of |^The largest |was compared;|^By its shape", line)]
    rows = [f"| {' | '.join(row)} |" for row in report["zones"]]
    return [text for text in (*sentences, *rows) if text not in words]


def checked(report: dict[str, Any]) -> dict[str, Any]:
    if report["errors"]:
        raise RuntimeError("\n".join(report["errors"]))
    return report


def keep(picture: Path, target: Path, size: int = 290_000) -> None:
    shrink(picture, target, size)
    print(target)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of the plugin at work in a real QGIS.")
    sessions = ("inspection", "screening", "panel", "dialogs", "setup", "tutorial", "motion")
    parser.add_argument("session", nargs="?", choices=sessions, default="inspection")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs" / "images", help="for the pictures")
    parser.add_argument("--cloud", type=Path, help="screening: this instead of a simulated one; all pictures are kept")
    parser.add_argument("--run", type=Path, help="motion: output folder instead of a simulated slope; all are kept")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="screening: fields of the dialog")
    parser.add_argument("--language", default="", help="dialogs: of QGIS's interface, such as zh-Hans")
    parser.add_argument("--only", nargs="*", default=[], metavar="ALGORITHM", help="dialogs: these instead of all")
    parser.add_argument("--values", type=Path, help="dialogs: JSON of values by algorithm, which are filled in and run")
    given = parser.parse_args()
    # Its name is in the pictures. Not in /tmp: QGIS marks layers from there.
    folder = Path("/var/tmp/slope")
    folder.mkdir()
    try:
        if given.session == "inspection":
            inspection(given.folder, folder)
        elif given.session == "dialogs":
            dialogs(given.folder, folder, given.language, " ".join(given.only), given.values)
        elif given.session == "setup":
            setup(given.folder, folder)
        elif given.session == "panel":
            panel(given.folder, folder)
        elif given.session == "tutorial":
            tutorial(given.folder, folder)
        elif given.session == "motion":
            motion(given.folder, folder, given.run)
        else:
            choices = dict(choice.split("=", 1) for choice in given.set)
            screening(given.folder, folder, given.cloud, choices)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()

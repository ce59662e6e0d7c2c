#!/usr/bin/env python3
"""Pictures of the plugin at work, for docs/images: a real QGIS on a display in memory (Xvfb).

``scripts/screenshots.py`` simulates two surveys, runs Inspect slope from its dialog and keeps the pictures;
``scripts/screenshots.py screening`` simulates one and runs Screen for hazards. The tests of the desktop use
``run_session`` with small surveys.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
START = 90.0  # seconds that QGIS may take to start
SCREEN = "1600x1000x24"
KEPT = ("desktop", "dialog", "toolbox", "zones")
SCREENING_KEPT = {"dialog": "screening_dialog", "layers": "screening_layers"}


def private_profile(folder: Path) -> dict[str, str]:
    """A QGIS profile with the plugin linked and switched on; gives the environment for QGIS programs."""
    plugins = folder / "profiles" / "default" / "python" / "plugins"
    plugins.mkdir(parents=True)
    (plugins / "slopewatch").symlink_to(ROOT)
    settings = folder / "profiles" / "default" / "QGIS" / "QGIS3.ini"
    settings.parent.mkdir(parents=True)
    settings.write_text(
        "[PythonPlugins]\nslopewatch=true\nprocessing=true\n\n"
        "[qgis]\ncheckVersion=false\nshowTips=false\nnewsFeed\\enabled=false\n\n"
        "[app]\nprojections\\unknownCrsBehavior=NoAction\n\n"
        "[core]\nnewsFeed\\httpsfeedqgisorg\\disabled=true\n",
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
) -> dict[str, Any]:
    """Run a session of this folder in a real QGIS; gives its report. Pictures lie in ``folder / "images"``.

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
    environment = private_profile(folder / "profile")
    environment["SLOPEWATCH_DESKTOP"] = str(task)
    session = str(ROOT / "scripts" / script)
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
from PIL import Image
picture = Image.open(sys.argv[1]).convert("RGB")
width = picture.width
while True:
    small = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
    # 5 bits a colour: noise of the clouds is most of what a PNG has to keep
    small = small.point([round(round(v / 255 * 31) / 31 * 255) for v in range(256)] * 3)
    file = io.BytesIO()
    small.save(file, "PNG", optimize=True)
    if file.tell() <= int(sys.argv[3]):
        break
    width = width * 15 // 16
open(sys.argv[2], "wb").write(file.getvalue())
"""


def shrink(source: Path, target: Path, size: int = 390_000) -> None:
    """Write the picture as a PNG of at most ``size`` bytes: fewer colours, then fewer pixels."""
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


def checked(report: dict[str, Any]) -> dict[str, Any]:
    if report["errors"]:
        raise RuntimeError("\n".join(report["errors"]))
    return report


def keep(picture: Path, target: Path) -> None:
    shrink(picture, target)
    print(target)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of the plugin at work in a real QGIS.")
    parser.add_argument("session", nargs="?", choices=("inspection", "screening"), default="inspection")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "docs" / "images", help="for the pictures")
    parser.add_argument("--cloud", type=Path, help="screening: this instead of a simulated one; all pictures are kept")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="screening: fields of the dialog")
    given = parser.parse_args()
    # Its name is in the pictures. Not in /tmp: QGIS marks layers from there.
    folder = Path("/var/tmp/slope")
    folder.mkdir()
    try:
        if given.session == "inspection":
            inspection(given.folder, folder)
        else:
            choices = dict(choice.split("=", 1) for choice in given.set)
            screening(given.folder, folder, given.cloud, choices)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()

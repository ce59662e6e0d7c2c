#!/usr/bin/env bash
# SlopeWatch's main job, done by QGIS on two simulated surveys whose truth is known; everything lands in demo/.
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."
root=$PWD

echo
echo "1. Two UAV surveys of a cut slope, a year apart, with known change under vegetation (about a million points each)"
rm -rf demo
.venv/bin/slopewatch simulate survey --output-dir demo/survey --points 1000000

echo
echo "2. QGIS inspects the slope: qgis_process run slopewatch:inspectslope"
export QT_QPA_PLATFORM=offscreen QGIS_CUSTOM_CONFIG_PATH=$root/.qgis
if [[ -z ${XDG_RUNTIME_DIR:-} ]]; then
    export XDG_RUNTIME_DIR=$root/.qgis/runtime
    mkdir -p -m 700 "$XDG_RUNTIME_DIR"
fi
PATH=/usr/bin:$PATH qgis_process run slopewatch:inspectslope -- \
    REFERENCE="$root/demo/survey/2024-05-01.laz" \
    CLOUD="$root/demo/survey/2025-05-01.laz" \
    ROI="$root/demo/survey/roi.gpkg" \
    OUTPUT_FOLDER="$root/demo/results"

echo
echo "3. What came out, beside the truth of the simulation"
.venv/bin/python scripts/demo_report.py demo/survey demo/results

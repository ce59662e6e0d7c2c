#!/usr/bin/env bash
# Sets SlopeWatch up in this checkout: PDAL, the engine's environment, QGIS, the plugin in a private QGIS profile.
# Usage: scripts/setup.sh [pdal|engine|qgis|profile]...   (all of them without an argument). Safe to run again at any time.
set -euo pipefail
here=$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd -P)
# shellcheck source=setup/common.sh
. "$here/setup/common.sh"
for part in pdal; do
    # shellcheck disable=SC1090
    . "$here/setup/$part.sh"
done
for step in "${@:-pdal}"; do "setup_$step"; done

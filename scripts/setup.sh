#!/usr/bin/env bash
# Sets SlopeWatch up in this checkout: PDAL, the engine's environment, QGIS, the plugin in a private QGIS profile.
# Usage: scripts/setup.sh [pdal|engine|qgis|profile|torch|install|uninstall]...   (the first four without an argument).
# Safe to run again at any time: what is there and works is used, what was cut short is done again.
set -euo pipefail
here=$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")" && pwd -P)
# shellcheck source=setup/common.sh
. "$here/setup/common.sh"
for part in pdal engine qgis profile; do
    # shellcheck disable=SC1090
    . "$here/setup/$part.sh"
done
named=again
(($#)) || {
    named=''
    set -- pdal engine qgis profile
}
for step in "$@"; do
    case $step in
        pdal) setup_pdal $named ;;
        engine | qgis | profile) "setup_$step" ;;
        torch) setup_torch again ;;
        install | uninstall) "${step}_plugin" ;;
        *) die "there is no step named $step" ;;
    esac
done
[[ $step == *install ]] || say "set-up finished"

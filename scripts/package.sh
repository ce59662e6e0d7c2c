#!/usr/bin/env bash
# The plugin's zip from the last commit, as QGIS and its plugin repository want it: one top folder named after the package.
# Usage: scripts/package.sh [FILE.zip]. What stays out is said in .gitattributes (export-ignore).
set -euo pipefail
cd "$(dirname -- "${BASH_SOURCE[0]}")/.."
version=$(git show HEAD:metadata.txt | sed -n 's/^version=//p')
archive=${1:-dist/slopewatch-$version.zip}
mkdir -p "$(dirname -- "$archive")"
git archive -9 --format=zip --prefix=slopewatch/ --output="$archive" HEAD
size=$(stat -c %s "$archive")
((size <= 4500 * 1024)) || {
    echo "$archive is larger than 4.5 MB" >&2
    exit 1
}
[[ -z $(git status --porcelain --untracked-files=no) ]] || echo "note: changes that are not committed are not in it"
echo "$archive ($((size / 1024)) KB)"

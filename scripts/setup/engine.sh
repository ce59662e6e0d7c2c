# The engine's own Python environment, .venv: never QGIS's interpreter, so that neither can break the other.
# shellcheck shell=bash

ENGINE_VENV=$ROOT/.venv
LOCK=$ROOT/scripts/setup/requirements.lock
TORCH_LOCK=$ROOT/scripts/setup/torch_cpu.lock
PYTHON_OLDEST=3.10
TORCH_OLDEST=2.6
TORCH_BELOW=2.15
TORCH_CPU_INDEX=https://download.pytorch.org/whl/cpu

python_version() { "$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null; }
python_is_new_enough() {
    local version
    version=$(python_version "$1") && [[ -n $version ]] && version_at_least "$version" "$PYTHON_OLDEST"
}

# The first Python that is new enough: `python3` as the user has it, then other names of it, then the system's.
find_python() {
    local name found
    for name in python3 python3.14 python3.13 python3.12 python3.11 python3.10 /usr/bin/python3; do
        found=$(command -v "$name") && python_is_new_enough "$found" && "$found" -c 'import sys; print(sys.executable)' && return 0
    done
    return 1
}
can_make_environments() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# ensure_python: sets PYTHON; installs the system's where there is none, and its venv module where that is missing.
ensure_python() {
    if ! PYTHON=$(find_python); then
        is_debian_like || die "no Python >= $PYTHON_OLDEST on PATH: install one"
        say "  no Python >= $PYTHON_OLDEST here: installing the system's"
        apt_install "the engine's Python" python3 python3-venv
        hash -r
        PYTHON=$(find_python) || die "this system's Python is older than $PYTHON_OLDEST: put a newer python3 first on PATH"
    fi
    if ! can_make_environments "$PYTHON"; then
        is_debian_like && [[ $PYTHON == /usr/bin/* ]] || die "$PYTHON cannot make virtual environments: install its venv and ensurepip modules"
        say "  $PYTHON has no venv module: installing python3-venv"
        apt_install "a virtual environment" python3-venv
    fi
}

pip_in() {
    local venv=$1
    shift
    "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"
}
# A virtual environment holds absolute paths, so one that was moved or copied is no longer whole.
is_environment_whole() { [[ -x $1/bin/python ]] && grep -qF "$1" "$1/bin/activate" 2>/dev/null && "$1/bin/python" -c 'import pip' 2>/dev/null; }

# fresh_environment VENV PYTHON [option]: a new one, unless a whole one stands there and no install in it was cut short.
fresh_environment() {
    local venv=$1 python=$2
    shift 2
    if [[ -e $venv ]] && { ! is_environment_whole "$venv" || [[ -e $venv/.unfinished ]]; }; then
        say "  $venv is not whole (an earlier run was cut short, or the folder was moved): making it anew"
        rm -rf "$venv"
    fi
    if [[ ! -e $venv ]]; then
        mkdir -p "$venv"
        : >"$venv/.unfinished"
        "$python" -m venv "$@" "$venv"
    fi
    : >"$venv/.unfinished"
}

# locked [--but] NAME...: the lock's lines of these packages, or of all but these, each with its hashes.
locked() {
    local but=no
    [[ $1 == --but ]] && but=yes && shift
    awk -v but="$but" -v names=" $* " '/^[^ #]/ { split($0, part, "=="); there = index(names, " " part[1] " ") > 0; take = but == "yes" ? !there : there }
        /^[^#]/ && take' "$LOCK"
}

# install_locked VENV [--but] NAME... [-- pip options]: exactly the locked versions, each file checked by its SHA-256 before it is
# used. Without looking for dependencies: the lock names all of them, and one that it does not name must not slip in.
install_locked() {
    local venv=$1 names=() list
    shift
    while (($#)) && [[ $1 != -- ]]; do
        names+=("$1")
        shift
    done
    (($#)) && shift
    mkdir -p "$STATE"
    list=$STATE/locked.txt
    locked "${names[@]}" >"$list"
    pip_in "$venv" install -qq --require-hashes --no-deps "$@" -r "$list"
}

engine_imports() {
    "$ENGINE_VENV/bin/python" -c 'import click, geopandas, jinja2, laspy, lazrs, matplotlib, numpy, pyogrio, pyproj, rasterio, rich, scipy, shapely
import pytest, hypothesis, slopewatch.engine'
}

setup_engine() {
    local key
    ensure_python
    key=$(step_key "$PYTHON" "$(python_version "$PYTHON")" -- "$ROOT/pyproject.toml" "$LOCK" "$ROOT/scripts/setup/engine.sh")
    if is_stamped engine "$key" && [[ ! -e $ENGINE_VENV/.unfinished ]] && "$ENGINE_VENV/bin/python" -c '' 2>/dev/null; then
        say "engine: .venv, as before"
        setup_torch
        return
    fi
    unstamp engine
    say "engine: its own Python environment in .venv, from $PYTHON ($(python_version "$PYTHON"))"
    fresh_environment "$ENGINE_VENV" "$PYTHON"
    say "  installing the pinned packages"
    # pyarrow stays out: pandas holds text in another way where it is there; GeoParquet asks for it by name
    install_locked "$ENGINE_VENV" --but torch pycsw pytest-qgis pyarrow ||
        die "pip could not install the engine's packages; a hash that differs means a file that is not the one that was tested (its message is above)"
    pip_in "$ENGINE_VENV" install -qq --no-deps --no-build-isolation -e "$ROOT" || die "pip could not install the engine (its message is above)"
    # mypy does not follow editable installs; it finds the package through this link.
    mkdir -p "$STATE/package"
    ln -sfn "$ROOT" "$STATE/package/slopewatch"
    engine_imports || die "the packages were installed but do not import (the message is above)"
    rm -f "$ENGINE_VENV/.unfinished"
    stamp engine "$key"
    say "  the engine's environment stands"
    unstamp torch
    setup_torch
}

# PyTorch serves training and the screening by points only, so the set-up goes on without it. On Linux PyPI's builds bring
# gigabytes of CUDA libraries; the build for processors is not there, so its hashes stand in a lock of their own.
setup_torch() {
    local key found list=$TORCH_LOCK
    key=$(step_key "$(python_version "$ENGINE_VENV/bin/python")" -- "$TORCH_LOCK" "$LOCK")
    if is_stamped torch "$key" && [[ ${1:-} != again ]]; then
        [[ -e $STATE/torch.missing ]] && say "PyTorch: not there, training and screening by points are off (to try again: scripts/setup.sh torch)"
        return 0
    fi
    mkdir -p "$STATE"
    rm -f "$STATE"/torch.{missing,log}
    : >"$STATE/torch.log"
    if [[ $(uname -s) != Linux ]]; then
        list=$STATE/torch.txt
        locked torch >"$list"
    fi
    if found=$("$ENGINE_VENV/bin/python" -c "import safetensors, torch; print(torch.__version__.split('+')[0])" 2>/dev/null) &&
        version_at_least "$found" "$TORCH_OLDEST" && ! version_at_least "$found" "$TORCH_BELOW"; then
        say "PyTorch: $found is there, used as it is"
    elif install_torch "$list" --timeout 60 || { [[ $list == "$TORCH_LOCK" ]] && install_torch "$list" --timeout 20 --index-url "$TORCH_CPU_INDEX"; }; then
        say "PyTorch: $("$ENGINE_VENV/bin/python" -c 'from importlib.metadata import version; print(version("torch"))') installed"
    else
        : >"$STATE/torch.missing"
        if grep -q 'DO NOT MATCH THE HASHES' "$STATE/torch.log"; then
            say "PyTorch: refused, because the file's SHA-256 is not listed in scripts/setup/torch_cpu.lock"
        fi
        say "PyTorch: no build that is listed could be had, so training and screening by points are off; all else works (to try again: scripts/setup.sh torch)"
    fi
    stamp torch "$key"
}
# install_torch LIST [pip options]: only a file whose hash is listed.
install_torch() { pip_in "$ENGINE_VENV" install -qq --require-hashes --no-deps --retries 1 "${@:2}" -r "$1" >>"$STATE/torch.log" 2>&1; }

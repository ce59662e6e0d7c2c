# QGIS >= 3.34, and the environment that tests the plugin in QGIS's own interpreter.
# shellcheck shell=bash

QGIS_OLDEST=3.34
QGIS_PYTHON=/usr/bin/python3
QGIS_VENV=$ROOT/.venv-qgis

# The version of the QGIS on this machine, or nothing: quickly from the packages, else from the program.
qgis_version() {
    command -v qgis_process >/dev/null || return 0
    local version
    version=$(dpkg-query -W -f='${db:Status-Status} ${Version}' qgis 2>/dev/null | sed -n 's/^installed //p' | first_version)
    [[ -n $version ]] || version=$(QT_QPA_PLATFORM=offscreen qgis_process --version 2>/dev/null | grep -i '^QGIS' | first_version)
    printf '%s\n' "$version"
}
qgis_imports() { "$QGIS_PYTHON" -c 'import qgis.core' 2>/dev/null; }
qgis_works() {
    local version
    version=$(qgis_version)
    [[ -n $version ]] && version_at_least "$version" "$QGIS_OLDEST"
}

# Debian 12's own QGIS is 3.22; its backports hold a newer one. The source stands beside the existing ones, from the same mirror.
add_backports() {
    local suite mirror file keyring='' candidate
    suite=$(os_field VERSION_CODENAME)-backports
    file=/etc/apt/sources.list.d/slopewatch-backports.list
    for candidate in /usr/share/keyrings/debian-archive-keyring.{gpg,pgp}; do
        [[ -z $keyring && -r $candidate ]] && keyring="[signed-by=$candidate] "
    done
    for mirror in $(debian_mirrors); do
        if [[ -z $(apt_sources | awk -v suite="$suite" '$2 == suite') || -e $file ]]; then
            say "  adding $suite from $mirror as $file"
            printf 'deb %s%s %s main\n' "$keyring" "$mirror" "$suite" | as_root tee "$file" >/dev/null
        fi
        APT_REFRESHED=no
        apt_refresh
        [[ -n $(apt-cache madison qgis 2>/dev/null | grep -F "$suite/") ]] && return
    done
    die "no mirror offers QGIS from $suite: check the network, name another in SLOPEWATCH_DEBIAN_MIRROR, or install QGIS >= $QGIS_OLDEST from qgis.org"
}

install_qgis() {
    local candidate packages=(qgis python3-qgis xvfb xauth python3-venv)
    is_debian_like || die "QGIS >= $QGIS_OLDEST is not installed: get it from qgis.org (or conda-forge: environment.yml)"
    can_be_root || die "QGIS >= $QGIS_OLDEST is missing and you may not install it: run this as root or with sudo rights, or have an administrator install the packages ${packages[*]}"
    apt_refresh
    candidate=$(apt_candidate qgis | first_version)
    if [[ -n $candidate ]] && version_at_least "$candidate" "$QGIS_OLDEST"; then
        say "  installing QGIS $candidate from this system's packages (about 1 GB on disk; the longest step, some minutes; its log is .setup/apt.log)"
        apt_install QGIS "${packages[@]}"
    elif [[ $(os_field VERSION_CODENAME) == bookworm ]]; then
        add_backports
        say "  installing QGIS from Debian's backports (about 1 GB on disk; the longest step, some minutes; its log is .setup/apt.log)"
        apt_install QGIS -t bookworm-backports "${packages[@]}"
    else
        die "this system offers QGIS ${candidate:-not at all}, and >= $QGIS_OLDEST is needed: install it from qgis.org"
    fi
    hash -r
    qgis_works || die "QGIS was installed but qgis_process does not start"
}

setup_qgis() {
    local missing=() program
    if qgis_works; then
        say "QGIS: $(qgis_version) is there, used as it is"
    else
        say "QGIS: none >= $QGIS_OLDEST found$(qgis_version | sed -n 's/..*/ (there is &)/p')"
        install_qgis
        say "  QGIS $(qgis_version) stands"
    fi
    # A display without a screen, for the test that clicks through the dialog.
    for program in Xvfb:xvfb xauth:xauth; do command -v "${program%%:*}" >/dev/null || missing+=("${program##*:}"); done
    if ((${#missing[@]})) && is_debian_like && can_be_root; then
        say "  installing ${missing[*]} for the test of the dialogs"
        apt_install "the test of the dialogs" "${missing[@]}"
    fi
    install_postgis
    setup_qgis_tests
}

# A PostgreSQL with PostGIS, for the tests of the hand-over; without it they are skipped.
install_postgis() {
    compgen -G '/usr/share/postgresql/*/extension/postgis.control' >/dev/null && return
    is_debian_like && can_be_root && [[ -n $(apt_candidate postgresql-postgis) ]] || return 0
    say "  installing PostgreSQL with PostGIS for the tests of the hand-over"
    # it brings the server of this release; the set-up goes on without it
    (apt_install "the tests of the hand-over to databases" postgresql-postgis) || return 0
}

setup_qgis_tests() {
    local key
    key=$(step_key "$(python_version "$QGIS_PYTHON")" "$(qgis_version)" -- "$LOCK" "$ROOT/scripts/setup/qgis.sh")
    if is_stamped qgis-tests "$key" && [[ ! -e $QGIS_VENV/.unfinished ]] && "$QGIS_VENV/bin/python" -c '' 2>/dev/null; then
        say "plugin tests: .venv-qgis, as before"
        return
    fi
    unstamp qgis-tests
    qgis_imports || die "QGIS's Python modules are not in $QGIS_PYTHON: install python3-qgis of the same version"
    say "plugin tests: pytest for QGIS's interpreter in .venv-qgis"
    can_make_environments "$QGIS_PYTHON" || apt_install "a virtual environment" python3-venv
    fresh_environment "$QGIS_VENV" "$QGIS_PYTHON" --system-site-packages
    install_locked "$QGIS_VENV" pytest pytest-qgis pytest-xdist execnet iniconfig packaging pluggy pygments colorama exceptiongroup tomli \
        typing-extensions pycsw || die "pip could not install pytest-qgis, pytest-xdist and pycsw (its message is above)"
    "$QGIS_VENV/bin/python" -c 'import pytest, pytest_qgis, qgis.core, xdist' || die "pytest-qgis does not import in $QGIS_VENV"
    rm -f "$QGIS_VENV/.unfinished"
    stamp qgis-tests "$key"
}

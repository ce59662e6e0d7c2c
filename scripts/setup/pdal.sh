# PDAL: one that is there and works, else what the system offers, else a private copy of Debian 11's under .pdal/, else none.
# shellcheck shell=bash
#
# Debian 12 and 13 ship no PDAL and PyPI holds only the sources of its bindings. Debian 11's packages clash with newer system
# libraries, so they are unpacked, with their own C library, into a folder of the checkout and never installed.

PDAL_OLDEST=2.2
PDAL_PREFIX=$ROOT/.pdal
PDAL_RELEASE=bullseye
WITHOUT_PDAL='laspy and shapely read and clip clouds instead (to try again: scripts/setup.sh pdal)'
DEBIAN_ARCHIVE=http://archive.debian.org/debian

# pdal_version PROGRAM: its version, or nothing where it does not start.
pdal_version() { "$1" --version 2>/dev/null | first_version; }

# pdal_works PROGRAM: it starts, is new enough, and carries points through a pipeline into LAZ and back.
pdal_works() {
    local version scratch summary
    version=$(pdal_version "$1")
    [[ -n $version ]] && version_at_least "$version" "$PDAL_OLDEST" || return 1
    scratch=$(mktemp -d) || return 1
    if printf '[{"type":"readers.faux","count":10,"mode":"random","bounds":"([0,1],[0,1],[0,1])"},{"type":"writers.las","filename":"%s/p.laz","compression":true}]' \
        "$scratch" | "$1" pipeline --stdin >/dev/null 2>&1 &&
        summary=$("$1" info --summary "$scratch/p.laz" 2>/dev/null) && [[ $summary == *'"num_points": 10'* ]]; then
        rm -rf "$scratch"
        return 0
    fi
    rm -rf "$scratch"
    return 1
}

# The PDAL to use, by the same order as the engine: SLOPEWATCH_PDAL, PATH, the private copy.
find_usable_pdal() {
    local candidate
    for candidate in "${SLOPEWATCH_PDAL:-}" "$(command -v pdal || true)" "$PDAL_PREFIX/bin/pdal"; do
        [[ -n $candidate && -x $candidate ]] || continue
        if pdal_works "$candidate"; then
            printf '%s\n' "$candidate"
            return 0
        fi
    done
    return 1
}

# Mirrors that may hold the old release: the one given, else this machine's own and Debian's archive of old releases.
pdal_mirrors() {
    debian_mirrors
    [[ -n ${SLOPEWATCH_DEBIAN_MIRROR:-} ]] || printf '%s\n' "$DEBIAN_ARCHIVE"
}

# pdal_write_wrapper PREFIX: PREFIX/bin/pdal, which starts the unpacked program with the loader and libraries unpacked with it.
pdal_write_wrapper() {
    local loader triplet
    loader=$(cd "$1" && printf '%s\n' lib/*/ld-2.*.so | sed -n 1p)
    triplet=$(basename "$(dirname "$loader")")
    mkdir -p "$1/bin"
    sed -e "s:@TRIPLET@:$triplet:g" -e "s:@LOADER@:$loader:g" "$ROOT/scripts/setup/pdal-wrapper.sh" >"$1/bin/pdal"
    chmod 755 "$1/bin/pdal"
}

# pdal_download MIRROR WORK: fetch PDAL and all it depends on, by apt with a root of its own; finished files are kept for a next try.
pdal_download() {
    local mirror=$1 work=$2 keyring
    for keyring in /usr/share/keyrings/debian-archive-keyring.{gpg,pgp}; do [[ -r $keyring ]] && break; done
    [[ -r $keyring ]] || {
        say "  the keyring of Debian's archive is missing: install the package debian-archive-keyring"
        return 1
    }
    rm -rf "$work/lists"
    mkdir -p "$work"/{etc/apt.conf.d,etc/preferences.d,lists/partial,archives/partial,log}
    : >"$work/status"
    printf 'deb [signed-by=%s] %s %s main\n' "$keyring" "$mirror" "$PDAL_RELEASE" >"$work/etc/sources.list"
    cat >"$work/etc/apt.conf" <<CONF
Dir::Etc::sourcelist "$work/etc/sources.list";
Dir::Etc::sourceparts "/dev/null";
Dir::Etc::preferences "/dev/null";
Dir::Etc::preferencesparts "/dev/null";
Dir::State "$work";
Dir::State::lists "$work/lists";
Dir::State::status "$work/status";
Dir::State::extended_states "$work/extended_states";
Dir::Cache "$work";
Dir::Cache::archives "$work/archives";
Dir::Log "$work/log";
APT::Sandbox::User "$(id -un)";
APT::Install-Recommends "false";
APT::Keep-Downloaded-Packages "true";
Acquire::Languages "none";
Acquire::Check-Valid-Until "false";
Acquire::Retries "3";
Acquire::http::Timeout "30";
Debug::NoLocking "true";
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
#clear DPkg::Pre-Install-Pkgs;
#clear DPkg::Pre-Invoke;
#clear DPkg::Post-Invoke;
#clear APT::Default-Release;
CONF
    pdal_lists "$work" || return 1
    if [[ $mirror == */debian ]]; then
        printf 'deb [signed-by=%s] %s %s main\n' "$keyring" "$mirror-security" "$PDAL_RELEASE-security" >>"$work/etc/sources.list"
        pdal_lists "$work" || say "  without Debian 11's security updates: $mirror-security did not give them"
    fi
    apt-get -c "$work/etc/apt.conf" -qq -y --download-only install pdal
}
pdal_lists() { apt-get -c "$1/etc/apt.conf" -qq -o Apt::Update::Error-Mode=any update; }

# The private copy; where none can be had it says why and fails.
build_private_pdal() {
    local work=$STATE/pdal-download fresh=$PDAL_PREFIX.new mirror package program got=no
    for program in apt-get dpkg-deb; do
        command -v "$program" >/dev/null || {
            say "  without $program none can be unpacked"
            return 1
        }
    done
    while read -r mirror; do
        say "  fetching PDAL of Debian 11 from $mirror into a folder of this checkout (nothing of the system changes)"
        if pdal_download "$mirror" "$work"; then
            got=yes
            break
        fi
        say "  $mirror did not give it"
    done < <(pdal_mirrors)
    [[ $got == yes ]] || return 1

    rm -rf "$fresh"
    mkdir -p "$fresh"
    for package in "$work"/archives/*.deb; do dpkg-deb -x "$package" "$fresh"; done
    rm -rf "$fresh"/usr/share/{doc,man,locale,lintian} "$fresh"/{etc,var}
    pdal_write_wrapper "$fresh"
    pdal_works "$fresh/bin/pdal" || {
        say "  the unpacked PDAL does not run on this machine: $("$fresh/bin/pdal" --version 2>&1 | awk 'NF {last = $0} END {print last}')"
        return 1
    }
    rm -rf "$PDAL_PREFIX"
    mv "$fresh" "$PDAL_PREFIX"
    rm -rf "$work"
}

# What was chosen last time, still the same file by size and time, needs no new trial.
pdal_key() {
    step_key "${SLOPEWATCH_PDAL:-}" "$(command -v pdal || true)" "$1" "$(stat -c '%s %Y' "$1" 2>/dev/null || true)" -- \
        "$ROOT/scripts/setup/pdal.sh" "$ROOT/scripts/setup/pdal-wrapper.sh"
}

# setup_pdal [again]: all works without PDAL, so the set-up goes on without one; it looks again where the step is asked for by name.
setup_pdal() {
    local program missing=$STATE/pdal.missing
    program=$(cat "$STATE/pdal.program" 2>/dev/null || true)
    if [[ -x $program ]] && is_stamped pdal "$(pdal_key "$program")"; then
        say "PDAL: $program, as before"
        return
    fi
    unstamp pdal
    if [[ -n ${SLOPEWATCH_PDAL:-} && $SLOPEWATCH_PDAL != none ]] && ! pdal_works "$SLOPEWATCH_PDAL"; then
        die "SLOPEWATCH_PDAL names $SLOPEWATCH_PDAL, which is no working PDAL >= $PDAL_OLDEST: correct or unset it"
    fi
    [[ ! -e $PDAL_PREFIX/bin/pdal ]] || pdal_write_wrapper "$PDAL_PREFIX"
    if program=$(find_usable_pdal); then
        say "PDAL: $program works (version $(pdal_version "$program")), used as it is"
    elif [[ ${SLOPEWATCH_PDAL:-} == none ]] || [[ -e $missing && ${1:-} != again ]]; then
        say "PDAL: none; $WITHOUT_PDAL"
        return
    else
        say "PDAL: none found that starts"
        if [[ -n $(apt_candidate pdal) ]] && version_at_least "$(apt_candidate pdal | first_version)" "$PDAL_OLDEST" && can_be_root; then
            say "  this system's own packages hold one"
            (apt_install PDAL pdal) || true
        else
            build_private_pdal || true
        fi
        if ! program=$(find_usable_pdal); then
            mkdir -p "$STATE"
            : >"$missing"
            say "  no PDAL could be had; $WITHOUT_PDAL"
            return
        fi
        say "  PDAL $(pdal_version "$program") stands: $program"
    fi
    mkdir -p "$STATE"
    rm -f "$missing"
    printf '%s\n' "$program" >"$STATE/pdal.program"
    stamp pdal "$(pdal_key "$program")"
}

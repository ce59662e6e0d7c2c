# Shared by the set-up scripts (bash, sourced): messages, versions, stamps, packages of the system.
# shellcheck shell=bash

ROOT=${SLOPEWATCH_ROOT:-$(CDPATH='' cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd -P)}
STATE=$ROOT/.setup
SETUP_STARTED=${SETUP_STARTED:-$SECONDS}

say() { printf '[%4ds] %s\n' "$((SECONDS - SETUP_STARTED))" "$*"; }
die() {
    printf 'set-up stopped: %s\n' "$*" >&2
    exit 1
}

# The first "1.2" or "1.2.3" in the text on standard input. All of it is read, here and wherever else a program is piped
# into a filter: one that stops early would kill the program before it, which counts as a failure (pipefail).
first_version() { awk '!found && match($0, /[0-9]+(\.[0-9]+)+/) { print substr($0, RSTART, RLENGTH); found = 1 }'; }

# version_at_least HAVE WANT: numeric, part by part ("3.40" is newer than "3.5").
version_at_least() {
    local have want i
    IFS=. read -ra have <<<"$1"
    IFS=. read -ra want <<<"$2"
    for i in 0 1 2 3; do
        ((10#${have[i]:-0} > 10#${want[i]:-0})) && return 0
        ((10#${have[i]:-0} < 10#${want[i]:-0})) && return 1
    done
    return 0
}

# A stamp says that a step was finished with exactly these inputs. It is written last, so a step that was cut short runs again.
# step_key [TEXT...] -- FILE...: one hash over the words, the files' contents and the place of the checkout.
step_key() {
    local words=()
    while (($#)) && [[ $1 != -- ]]; do
        words+=("$1")
        shift
    done
    (($#)) && shift
    { printf '%s\n' "$ROOT" "${words[@]}"; (($# == 0)) || cat -- "$@"; } | sha256sum | cut -d' ' -f1
}
is_stamped() { [[ -f $STATE/$1.stamp && $(<"$STATE/$1.stamp") == "$2" ]]; }
stamp() {
    mkdir -p "$STATE"
    printf '%s\n' "$2" >"$STATE/$1.stamp.new"
    mv -f "$STATE/$1.stamp.new" "$STATE/$1.stamp"
}
unstamp() { rm -f "$STATE/$1.stamp"; }

# --- packages of the system -------------------------------------------------------------------------------------------
is_debian_like() { command -v apt-get >/dev/null && command -v dpkg >/dev/null; }
os_field() { (
    # shellcheck disable=SC1091
    . "${OS_RELEASE:-/etc/os-release}" 2>/dev/null && eval "printf '%s' \"\${$1:-}\""
); }

# May ask for the password once, on the terminal; without one it fails at once.
can_be_root() { ((EUID == 0)) || { command -v sudo >/dev/null && sudo -v 2>/dev/null; }; }
as_root() { if ((EUID == 0)); then "$@"; else sudo -- "$@"; fi; }

# Every configured package source of the system: URI, suite and component, whatever format its file has.
apt_sources() { apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' 2>/dev/null; }
# The mirror that this machine takes its own release from.
apt_mirror() { apt_sources | awk -v release="$(os_field VERSION_CODENAME)" '$2 == release && $3 == "main" && !found++ {print $1}'; }
# Where Debian's packages are looked for: the mirror given in place of all others, or this machine's own.
debian_mirrors() { printf '%s\n' "${SLOPEWATCH_DEBIAN_MIRROR:-$(apt_mirror)}" | sed 's:/*$::' | awk NF; }
apt_candidate() { apt-cache policy "$1" 2>/dev/null | awk '$1 == "Candidate:" && $2 != "(none)" {print $2}'; }

# Package runs are long-winded: their output goes to a log, of which the end is shown where one fails.
APT_LOG=$STATE/apt.log
logged_as_root() {
    mkdir -p "$STATE"
    as_root "$@" >>"$APT_LOG" 2>&1 </dev/null
}

APT_REFRESHED=no
apt_refresh() {
    [[ $APT_REFRESHED == no ]] || return 0
    say "  refreshing the package lists"
    # One foreign source that does not answer must not stop the set-up: what is needed is looked for afterwards.
    logged_as_root apt-get -q update -o Acquire::Retries=2 -o Acquire::http::Timeout=30 -o Acquire::https::Timeout=30 -o DPkg::Lock::Timeout=300 ||
        say "  some package sources did not answer; going on with the others"
    APT_REFRESHED=yes
}

# apt_install REASON [apt options] PACKAGE...
apt_install() {
    local reason=$1
    shift
    can_be_root ||
        die "$reason needs Debian packages and you may not install them: run this as root or with sudo rights, or have an administrator run: apt-get install --no-install-recommends $*"
    # A package run that was cut short earlier is finished first.
    [[ -z $(dpkg --audit 2>/dev/null) ]] || logged_as_root env DEBIAN_FRONTEND=noninteractive dpkg --force-confold --configure -a || true
    apt_refresh
    logged_as_root env DEBIAN_FRONTEND=noninteractive apt-get -q -y install --no-install-recommends -o Dpkg::Use-Pty=0 \
        -o Dpkg::Options::=--force-confold -o DPkg::Lock::Timeout=300 "$@" || {
        tail -n 8 "$APT_LOG" >&2
        die "$reason: apt-get could not install $* (the end of its log, $APT_LOG, is above)"
    }
}

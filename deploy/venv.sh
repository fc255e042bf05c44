#!/usr/bin/env bash
# Makes (or mends) the virtual environment of this checkout from a lock file with hashes.
#
#   deploy/venv.sh [--system-site-packages] LOCK
#
# Needs python3 >= 3.11 and nothing else. Where Debian's python3 came without ensurepip, installs python3-venv if it
# may (root, or sudo, asking for the password on a terminal), else ends with the one line to run.
# Environment: PYTHON names another interpreter; ALIGHT_NO_SYSTEM=1 forbids touching the system.
set -euo pipefail
cd "$(dirname "$0")/.."
venv=.venv
site=()
if [ "${1:-}" = --system-site-packages ]; then site=(--system-site-packages); shift; fi
lock=$1

die() { printf 'alight: %s\n' "$*" >&2; exit 2; }

find_python() {
    local candidate candidates=${PYTHON:-python3 python3.11 python3.12 python3.13 python3.14}
    for candidate in $candidates; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11) or sys.maxsize < 2**32)' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    die "no 64-bit Python 3.11 or newer among: $candidates; install one, or name it: make PYTHON=/path/to/python3.11"
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; elif [ -t 0 ]; then sudo "$@"; else sudo -n "$@"; fi
}

install_ensurepip() {
    local version package
    version=$("$1" -c 'import sys; print(f"{sys.version_info[0]}.{sys.version_info[1]}")')
    package=python3-venv
    case $(readlink -f "$1") in
        /usr/bin/python"$version")
            # Debian's default interpreter goes by the unversioned name, any other by its version.
            [ "$(readlink -f /usr/bin/python3)" = "/usr/bin/python$version" ] || package=python$version-venv ;;
        *) die "$1 lacks ensurepip; reinstall that Python with pip, or name another: make PYTHON=..." ;;
    esac
    if [ "${ALIGHT_NO_SYSTEM:-}" = 1 ] || ! command -v apt-get >/dev/null || ! as_root true 2>/dev/null; then
        die "$1 lacks ensurepip; run: sudo apt-get install $package   and then this again"
    fi
    echo "alight: installing $package, which this Python lacks"
    export DEBIAN_FRONTEND=noninteractive
    local said
    if ! said=$(as_root apt-get install -y --no-install-recommends "$package" 2>&1) &&
        ! said=$(as_root apt-get update 2>&1 && as_root apt-get install -y --no-install-recommends "$package" 2>&1); then
        printf '%s\n' "$said" >&2
        die "$package could not be installed; run: sudo apt-get install $package   and then this again"
    fi
}

python=$(find_python)
"$python" -c 'import ensurepip, venv' 2>/dev/null || install_ensurepip "$python"

# A virtual environment holds absolute paths: one that was copied or moved here is made anew, and so is a broken one, one
# of another Python than was asked for, and one that can't see the system's packages where they are wanted.
usable() {
    head -n 2 "$venv/bin/pip" 2>/dev/null | grep -qF "$PWD/$venv/bin/" &&
        "$venv/bin/python" -m pip --version >/dev/null 2>&1 &&
        [ "$(base_of "$venv/bin/python")" = "$(base_of "$python")" ] &&
        { [ -z "${site[*]:-}" ] || grep -qi '^include-system-site-packages *= *true' "$venv/pyvenv.cfg"; }
}
base_of() { "$1" -c 'import sys; print(sys.version_info[:2], sys.base_prefix)'; }

if [ -e "$venv" ] && ! usable; then
    echo "alight: making $venv anew (it was made elsewhere, by another Python, or not to the end)"
    rm -rf "$venv"
fi
[ -e "$venv" ] || "$python" -m venv "${site[@]}" "$venv"

pip=("$venv/bin/python" -m pip --disable-pip-version-check --quiet)
# The lock is complete: no dependency is looked for beside it. Byte code is made when a module is first imported, which
# is far less than all of it.
if ! "${pip[@]}" install --no-deps --no-compile --require-hashes -r "$lock"; then
    die "the packages of $lock could not be installed (see above); mend the network or pip's configuration and run this again"
fi
# setuptools comes from the lock, so nothing is fetched here.
"${pip[@]}" install --no-deps --no-build-isolation --editable . ||
    die "alight itself could not be installed (see above)"

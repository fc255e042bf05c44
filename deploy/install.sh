#!/usr/bin/env bash
# Installs this checkout on the machine that it lies on; `make deploy` runs it on the Pi, and so can a person.
# Asks for root only where something is missing: packages of apt, the service, the user's groups.
# Environment: CONFIG (rig file, from this checkout), RESTART=1 (start the service), ALIGHT_NO_SYSTEM=1 (leave the
# system alone: no apt, no service, no groups), PYTHON (another interpreter).
# Ends with 0 if Alight is installed and its preflight check found nothing, 1 if the check found faults, 2 if not installed.
set -euo pipefail
cd "$(dirname "$0")/.."
CONFIG=${CONFIG:-configs/raspberry-pi.toml} RESTART=${RESTART:-}
# Made to be run over ssh with a bare environment.
export PATH=$PATH:/usr/sbin:/sbin

say() { printf 'alight: %s\n' "$*"; }
die() { printf 'alight: %s\n' "$*" >&2; exit 2; }
as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"
    elif sudo -n true 2>/dev/null; then sudo -n "$@"
    elif [ -t 0 ]; then sudo "$@"
    else die "root is needed for this; run on $(hostname): sudo $*"; fi
}

[ -f "$CONFIG" ] || die "$CONFIG: no such file in $PWD; give one of: $(printf '%s ' configs/*.toml)"
[ "$(getconf LONG_BIT)" = 64 ] || die "this is a 32-bit system, and MAVSDK has 64-bit wheels only; install the 64-bit Raspberry Pi OS"
case $(uname -m) in aarch64 | x86_64) ;; *) die "$(uname -m): MAVSDK has wheels for aarch64 and x86-64 only" ;; esac
system=1
if [ "${ALIGHT_NO_SYSTEM:-}" = 1 ]; then
    system=
    say "ALIGHT_NO_SYSTEM=1: no packages, groups or service are installed"
fi
pi=
if grep -qs 'Raspberry Pi' /proc/device-tree/model; then pi=1; fi

# ---- packages: libcamera and picamera2 come from apt, built for the Pi's own kernel and camera stack
if [ -n "$system" ] && [ -n "$pi" ] && ! /usr/bin/python3 -c 'import picamera2' 2>/dev/null; then
    say "installing python3-picamera2"
    get=(env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends python3-picamera2)
    as_root "${get[@]}" >/dev/null || { as_root apt-get update -q >/dev/null && as_root "${get[@]}" >/dev/null; } ||
        die "it could not be installed; run: sudo apt-get update && sudo apt-get install --no-install-recommends python3-picamera2"
fi
[ -n "$pi" ] || say "no Raspberry Pi: picamera2 is left out"

# ---- Python
say "installing the packages of requirements.lock into $PWD/.venv"
deploy/venv.sh --system-site-packages requirements.lock
if [ -n "$pi" ] && /usr/bin/python3 -c 'import numpy, sys; sys.exit(int(numpy.__version__.split(".")[0]) >= 2)' 2>/dev/null; then
    say "this system's simplejpeg is built for numpy 1: installing its own into .venv"
    .venv/bin/python -m pip install --disable-pip-version-check --quiet --ignore-installed --no-deps --require-hashes \
        -r deploy/raspberry-pi/simplejpeg.lock
fi
# The service may not write here, so byte code is made now, or it would be made at every start; that of the packages is
# made by the check below, which imports them.
.venv/bin/python -m compileall -q app drivers
mkdir -p flights

# ---- system
joined=
if [ -n "$system" ] && [ -n "$pi" ]; then
    for group in dialout video render; do
        if getent group "$group" >/dev/null && ! id -nG | grep -qw "$group"; then
            say "adding $(id -un) to the group $group, from the next login on"
            as_root usermod -aG "$group" "$(id -un)"
            joined=1
        fi
    done
    if grep -qE 'console=(serial0|ttyAMA0|ttyS0)' /proc/cmdline; then
        say "WARNING: a login console is on the UART that goes to the autopilot; see deploy/raspberry-pi/config.txt"
    fi
    [ -e /dev/ttyAMA0 ] || say "WARNING: no /dev/ttyAMA0: add the lines of deploy/raspberry-pi/config.txt and reboot"
fi
unit=/etc/systemd/system/alight.service
service=
if [ -n "$system" ] && [ -d /run/systemd/system ]; then
    filled=$(mktemp)
    trap 'rm -f "$filled"' EXIT
    deploy/unit.sh "$CONFIG" >"$filled"
    # The one folder that the service may write to. If it can't be made, the check below says so.
    mkdir -p "$(sed -n 's/^ReadWritePaths=-//p' "$filled")" 2>/dev/null || true
    if ! cmp -s "$filled" "$unit"; then
        say "installing the service alight"
        as_root install -m 644 "$filled" "$unit"
        as_root systemctl daemon-reload
    fi
    systemctl is-enabled --quiet alight 2>/dev/null || as_root systemctl enable --quiet alight
    service=1
elif [ -n "$system" ]; then
    say "no systemd here: the service is not installed; start it with: .venv/bin/alight run --config $CONFIG"
fi

# ---- does it fly?
say "installed $(cat .deployed 2>/dev/null || echo '(by hand)'); checking"
check=(.venv/bin/alight check --config "$CONFIG")
if [ -n "$joined" ] && [ "$(id -u)" != 0 ]; then
    # This session is older than that, and finds the devices shut; the service will not.
    check=(as_root setpriv --reuid "$(id -u)" --regid "$(id -g)" --init-groups env HOME="$HOME" "${check[@]}")
fi
if ! "${check[@]}"; then
    say "installed, but the check found faults (above); mend them and run: .venv/bin/alight check --config $CONFIG"
    [ -z "$service" ] || say "then: sudo systemctl start alight"
    exit 1
fi
if [ -n "$service" ] && [ "$RESTART" = 1 ]; then
    as_root systemctl restart alight
    say "running; its log: journalctl -fu alight"
elif [ -n "$service" ]; then
    say "ready; it starts at the next boot, or now with: sudo systemctl start alight"
fi

#!/usr/bin/env bash
# `make deploy`: copies this checkout to a Raspberry Pi (or any Linux with ssh and rsync) and installs it there.
# Environment, set by the Makefile: HOST=user@pi, DIR (on the Pi, from its home), PORT, CONFIG (the rig file to run),
# RESTART=1 (stop a running Alight, start it afterwards); and SSH_OPTS (more options for ssh), PYTHON and
# ALIGHT_NO_SYSTEM (passed on to deploy/install.sh).
set -euo pipefail
cd "$(dirname "$0")/.."

die() { printf 'alight: %s\n' "$*" >&2; exit 2; }
HOST=${HOST:-} DIR=${DIR:-alight} PORT=${PORT:-22} CONFIG=${CONFIG:-configs/raspberry-pi.toml} RESTART=${RESTART:-}

[ -n "$HOST" ] || die "deploy where to? make deploy HOST=user@pi"
[[ $HOST =~ ^[A-Za-z0-9_][A-Za-z0-9_.@:-]*$ ]] || die "HOST=$HOST is no host name; make deploy HOST=user@pi"
[[ $PORT =~ ^[0-9]+$ ]] || die "PORT=$PORT is no number; give ssh's port"
[[ $DIR =~ ^[A-Za-z0-9_./-]+$ ]] || die "DIR=$DIR: give a folder on $HOST of letters, digits and ._/- only"
[[ $CONFIG =~ ^[A-Za-z0-9_./-]+$ ]] || die "CONFIG=$CONFIG: give a path of letters, digits and ._/- only"
for tool in ssh rsync; do
    command -v "$tool" >/dev/null || die "$tool is not installed here; run: sudo apt-get install openssh-client rsync"
done

# One connection for all steps: a password is asked for once.
sockets=$(mktemp -d)
# shellcheck disable=SC2206  # SSH_OPTS is words
ssh=(ssh -p "$PORT" -o ConnectTimeout=10 -o ControlMaster=auto -o "ControlPath=$sockets/%C" -o ControlPersist=60 ${SSH_OPTS:-})
close() {
    "${ssh[@]}" -O exit "$HOST" 2>/dev/null || true
    rm -rf "$sockets"
}
trap close EXIT

echo "alight: looking at $HOST"
rc=0
"${ssh[@]}" "$HOST" "DIR='$DIR' RESTART='$RESTART' ALIGHT_NO_SYSTEM='${ALIGHT_NO_SYSTEM:-}' bash -s" <<'REMOTE' || rc=$?
set -eu
die() { printf 'alight: %s\n' "$*" >&2; exit 2; }
command -v rsync >/dev/null || die "rsync is missing on $(hostname); run there: sudo apt-get install rsync"
# What is not in the checkout is deleted from DIR, so DIR must be ours.
if [ -e "$DIR" ] && [ -n "$(ls -A "$DIR")" ] && ! grep -qs '^name = "alight"' "$DIR/pyproject.toml"; then
    die "$DIR on $(hostname) holds something else; give an empty or a new folder: make deploy DIR=..."
fi
if [ "$ALIGHT_NO_SYSTEM" != 1 ] && [ -d /run/systemd/system ] && systemctl is-active --quiet alight; then
    [ "$RESTART" = 1 ] || die "Alight is running on $(hostname), and may be flying; on the ground: make deploy RESTART=1 ..."
    if [ "$(id -u)" = 0 ]; then systemctl stop alight; else sudo -n systemctl stop alight ||
        die "can't stop it; run there: sudo systemctl stop alight"; fi
fi
mkdir -p "$DIR"
REMOTE
[ "$rc" = 255 ] && die "$HOST does not answer ssh on port $PORT (see above); is it on, and is the key or password right?"
[ "$rc" = 0 ] || exit "$rc"

echo "alight: copying to $HOST:$DIR"
# Rig, camera and pad files that were added on the Pi stay. What .gitignore names is neither copied nor deleted.
rsync -a --delete --exclude=/.git --filter=':- .gitignore' --filter='P /configs/***' --filter='P /.deployed' \
    -e "$(printf '%q ' "${ssh[@]}")" ./ "$HOST:$DIR/" || die "copying to $HOST:$DIR failed (see above)"
version=$(git describe --always --dirty 2>/dev/null || echo unknown)

terminal=()
if [ -t 0 ] && [ -t 1 ]; then terminal=(-t); fi
"${ssh[@]}" "${terminal[@]}" "$HOST" "cd '$DIR' && echo '$version' >.deployed &&
    CONFIG='$CONFIG' RESTART='$RESTART' ALIGHT_NO_SYSTEM='${ALIGHT_NO_SYSTEM:-}' PYTHON='${PYTHON:-}' bash deploy/install.sh"

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
# Stale files are deleted from the code folders of DIR, so DIR must be ours.
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
# Compared by what is in the files, for a checkout gives them a new time. What .gitignore names stays here.
copy=(rsync -a --checksum --exclude-from=.gitignore -e "$(printf '%q ' "${ssh[@]}")")
# The project's own: there it is as it is here, and a file that is stale in one of these folders goes. Nothing else of
# DIR is deleted: flight records, calibrations and rigs are made on the Pi.
own=(app deploy docs drivers tests .ci .gitignore CHANGELOG.md LICENSE Makefile README.md pyproject.toml
    requirements.lock requirements-dev.lock)
"${copy[@]}" --delete "${own[@]}" "$HOST:$DIR/" || die "copying to $HOST:$DIR failed (see above)"
# The rest, configs/ above all: where the Pi has another file of that name, that is kept beside the new one.
kept=.before-$(date -u +%Y-%m-%dT%H-%M-%SZ)-$$  # two pushes within a second keep their own
rc=0
"${copy[@]}" --backup --suffix="$kept" --exclude=/.git --exclude=/.deployed "${own[@]/#/--exclude=/}" \
    ./ "$HOST:$DIR/" || rc=$?
{ "${ssh[@]}" "$HOST" "cd '$DIR' && find . -name .venv -prune -o -name '*$kept' -printf '%P\\n'" </dev/null || true; } |
    while read -r old; do
        echo "alight: $HOST had another ${old%"$kept"}; it is replaced, and kept there as $old"
    done
[ "$rc" = 0 ] || die "copying to $HOST:$DIR failed (see above)"
version=$(git describe --always --dirty 2>/dev/null || echo unknown)

terminal=()
if [ -t 0 ] && [ -t 1 ]; then terminal=(-t); fi
"${ssh[@]}" "${terminal[@]}" "$HOST" "cd '$DIR' && echo '$version' >.deployed &&
    CONFIG='$CONFIG' RESTART='$RESTART' ALIGHT_NO_SYSTEM='${ALIGHT_NO_SYSTEM:-}' PYTHON='${PYTHON:-}' bash deploy/install.sh"

#!/usr/bin/env bash
# Resolves pyproject.toml into requirements.lock (what Alight runs on, and setuptools to install it) and
# requirements-dev.lock (with the tools of `make check`): exact versions, and the hashes of every wheel, so one lock
# serves x86-64 and aarch64, Python 3.11 and newer. Resolved on the oldest Python, whose set includes the newer ones'.
# Arguments go to pip-compile: --upgrade, or --upgrade-package NAME.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${PYTHON:-python3.11}
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' ||
    { echo "alight: make lock needs Python 3.11; name one: make lock PYTHON=..." >&2; exit 2; }
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
"$python" -m venv "$tools"
"$tools/bin/pip" --disable-pip-version-check --quiet install 'pip-tools>=7.4,<8'

compile() {
    "$tools/bin/pip-compile" --quiet --generate-hashes --allow-unsafe --strip-extras --newline lf --no-header \
        --no-emit-options --no-emit-index-url --no-emit-find-links --no-emit-trusted-host \
        --build-deps-for editable "$@" pyproject.toml
}
compile --output-file requirements.lock "$@"
compile --output-file requirements-dev.lock --extra dev --constraint requirements.lock "$@"
pins=$(mktemp -d)
trap 'rm -rf "$tools" "$pins"' EXIT
echo simplejpeg >"$pins/simplejpeg.in"
cp deploy/raspberry-pi/simplejpeg.lock "$pins/all.lock"
"$tools/bin/pip-compile" --quiet --generate-hashes --no-annotate --no-header --no-emit-options --no-emit-index-url \
    --no-emit-find-links --no-emit-trusted-host --constraint requirements.lock --output-file "$pins/all.lock" "$@" \
    "$pins/simplejpeg.in"
# Its one dependency, numpy, is in requirements.lock.
sed -n '/^simplejpeg==/,/[^\\]$/p' "$pins/all.lock" >deploy/raspberry-pi/simplejpeg.lock
for lock in requirements.lock requirements-dev.lock deploy/raspberry-pi/simplejpeg.lock; do
    # shellcheck disable=SC2016  # the quotes are part of the words
    sed -i '/^# Written by/d; 1i # Written by `make lock` from pyproject.toml: exact versions, hashes of every wheel. Not edited by hand.' "$lock"
done

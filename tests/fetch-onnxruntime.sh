#!/bin/sh
# Prints the absolute path of onnxruntime's shared library, for ORT_DYLIB_PATH; fetches it on the first call.
# It is taken out of the Python wheel, without installing anything: python3 with pip is all that is needed.
#   ORT_DYLIB_PATH=$(tests/fetch-onnxruntime.sh) cargo test --release --workspace
set -eu

version=1.31.1
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
folder="$root/target/onnxruntime/$version"
library="$folder/libonnxruntime.so.$version"

if [ ! -f "$library" ]; then
    mkdir -p "$folder"
    work=$(mktemp -d "$folder/fetch.XXXXXX")
    trap 'rm -rf "$work"' EXIT
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
        --dest "$work" "onnxruntime==$version" >&2
    # Renamed into place last, so that an interrupted call leaves nothing that looks complete.
    python3 - "$work" "$version" <<'PYTHON'
import glob, shutil, sys, zipfile
work, version = sys.argv[1:]
name = f"libonnxruntime.so.{version}"
with zipfile.ZipFile(glob.glob(f"{work}/*.whl")[0]) as wheel:
    with wheel.open(f"onnxruntime/capi/{name}") as source, open(f"{work}/{name}", "wb") as target:
        shutil.copyfileobj(source, target)
PYTHON
    mv "$work/libonnxruntime.so.$version" "$library"
fi
printf '%s\n' "$library"

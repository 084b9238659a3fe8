#!/bin/sh
# Prints the absolute path of onnxruntime's shared library, for ORT_DYLIB_PATH; fetches it on the first call.
#   ORT_DYLIB_PATH=$(tests/fetch-onnxruntime.sh) cargo test --release --workspace
set -eu

version=1.31.1
library="libonnxruntime.so.$version"
folder=$(sh "$(dirname -- "$0")/fetch-from-wheel.sh" onnxruntime "$version" "onnxruntime/capi/$library")
printf '%s\n' "$folder/$library"

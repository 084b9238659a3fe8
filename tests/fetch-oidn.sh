#!/bin/sh
# Prints the absolute path of Open Image Denoise's shared library, for OIDN_DYLIB_PATH; fetches it on the first call, with the libraries
# that it loads from its own folder. The wheel has 88 MB, what is kept of it 56.
#   OIDN_DYLIB_PATH=$(tests/fetch-oidn.sh) cargo run --release -- render scenes/cornell -o out.png --spp 16 --denoise
set -eu

lib=pyoidn/oidn/lib
folder=$(sh "$(dirname -- "$0")/fetch-from-wheel.sh" pyoidn 2.5.1.0 "$lib/libOpenImageDenoise.so.2" \
    "$lib/libOpenImageDenoise_core.so.*" "$lib/libOpenImageDenoise_device_cpu.so.*" "$lib/libtbb.so.12")
printf '%s\n' "$folder/libOpenImageDenoise.so.2"

#!/usr/bin/env python3
"""Whether two builds render the same bits: scenes by modes, after a change that must change nothing.

    tests/bench/same.py BEFORE AFTER [SCENE...] [--spp 24] [--size 96x72] [--methods none,ppg,...]

BEFORE and AFTER are programs. Without scenes those of ours are rendered. Ends with 1 where a picture differs.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
OURS = ["cornell", "door-ajar", "glass-caustic", "lamp-room", "blinds", "starfield"]
METHODS = "none,ppg,variance,hybrid,gaussian,neural"


def run(*command):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True).stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("builds", nargs=2, metavar="BUILD")
    parser.add_argument("scenes", nargs="*", default=[ROOT / "scenes" / name for name in OURS])
    parser.add_argument("--spp", default="24")
    parser.add_argument("--size", default="96x72")
    parser.add_argument("--methods", default=METHODS)
    options = parser.parse_args()
    arguments = ["--spp", options.spp, "--size", options.size, "--seed", "1"]
    differ = 0
    with tempfile.TemporaryDirectory() as folder:
        paths = [pathlib.Path(folder) / name for name in ("before.exr", "after.exr")]
        for scene in options.scenes:
            for method in options.methods.split(","):
                for build, path in zip(options.builds, paths):
                    run(build, "render", scene, "-o", path, "--guide", method, "--quiet", *arguments)
                error = json.loads(run(options.builds[1], "error", *paths, "--json"))["relmse"]
                differ += error != 0
                told = "the same" if error == 0 else f"DIFFERS, relMSE {error:.3g}"
                print(f"{pathlib.Path(scene).name} {method}: {told}", flush=True)
    print(f"{differ} pictures differ")
    sys.exit(1 if differ else 0)


if __name__ == "__main__":
    main()

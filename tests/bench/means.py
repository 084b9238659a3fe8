#!/usr/bin/env python3
"""Whether the mean of pictures moves with what a render decides on its way, such as to give guiding up.

    python3 tests/bench/means.py SCENE --build before=PATH --build 'after=PATH --past 0' \\
        [--guide gaussian] [--size 8x6] [--spp 256] [--runs 2000] [--reference-spp 1000000] [--json FILE]

Renders a tiny picture with every seed from 1 to RUNS by every build, and a reference by the first build without guiding. Printed are the
mean over the runs of the picture's mean over that of the reference, with its standard error, and the same of the runs in which guiding
was given up and of the others: these may differ from 1, since what was decided depends on the samples; the mean of all may not. The
reference's own standard error is that of one render of so many samples. Only Python's own library is needed.
"""

import argparse
import concurrent.futures
import json
import math
import os
import pathlib
import shlex
import statistics
import subprocess
import sys
import tempfile


def render(command, scene, options, out):
    words = shlex.split(command)
    subprocess.run([words[0], "render", scene, "-o", out, "--quiet", *options, *words[1:]], check=True)


def mean_ratio(command, picture, reference):
    words = [shlex.split(command)[0], "error", picture, reference, "--json"]
    return json.loads(subprocess.run(words, check=True, capture_output=True).stdout)["mean_ratio"]


def told(ratios):
    if len(ratios) < 2:
        return f"{len(ratios)} runs"
    error = statistics.stdev(ratios) / math.sqrt(len(ratios))
    return f"{len(ratios)} runs {statistics.mean(ratios):.5f} +-{error:.5f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("--build", action="append", required=True, metavar="NAME=COMMAND")
    parser.add_argument("--guide", default="gaussian")
    parser.add_argument("--size", default="8x6")
    parser.add_argument("--spp", default="256")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--reference-spp", default="1000000")
    parser.add_argument("--json", type=pathlib.Path)
    args = parser.parse_args()
    builds = [build.split("=", 1) for build in args.build]
    runs = {name: [] for name, _ in builds}
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        folder = pathlib.Path(folder)
        reference = folder / "reference.exr"
        render(builds[0][1], args.scene, ["--guide", "none", "--size", args.size, "--spp", args.reference_spp], reference)

        def run(name, command, seed):
            out, statistics_file = folder / f"{name}-{seed}.exr", folder / f"{name}-{seed}.json"
            options = ["--guide", args.guide, "--size", args.size, "--spp", args.spp, "--seed", str(seed)]
            render(command, args.scene, [*options, "--threads", "1", "--stats", statistics_file], out)
            gave_up = any("off: it does not pay" in text for text in json.loads(statistics_file.read_text())["decisions"])
            ratio = mean_ratio(command, out, reference)
            out.unlink()
            statistics_file.unlink()
            return {"seed": seed, "ratio": ratio, "gave_up": gave_up}

        jobs = [(name, pool.submit(run, name, command, seed)) for seed in range(1, args.runs + 1) for name, command in builds]
        for name, job in jobs:
            runs[name].append(job.result())
    for name, of in runs.items():
        parts = {"all": of, "given up": [r for r in of if r["gave_up"]], "guided": [r for r in of if not r["gave_up"]]}
        print(f"{name:10}" + " | ".join(f"{part}: {told([r['ratio'] for r in some])}" for part, some in parts.items()))
    if args.json:
        args.json.write_text(json.dumps(runs, indent=1))


if __name__ == "__main__":
    sys.exit(main())

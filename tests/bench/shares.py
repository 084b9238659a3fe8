#!/usr/bin/env python3
"""What learning gains by being shared: noise of pictures by a guide of one process, of several, and of one with all their samples.

    python3 tests/bench/shares.py FANAL SCENE... [--parts 8] [--learn 32] [--spp 64] [--size 128x96] [--guide gaussian] [--pairs 2]

For each scene three guides are learned: by one process from LEARN samples per pixel (the time of one node), by PARTS processes from as many
each (the same time, if there are as many machines), and by one from PARTS times LEARN (the same total time). The noise is the trimmed
relMSE between two pictures of the same guide with other seeds, which is about twice the error of one; the mean over PAIRS is told, relative to
that of the first guide.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fanal")
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--parts", type=int, default=8)
    parser.add_argument("--learn", type=int, default=32)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--pairs", type=int, default=2)
    parser.add_argument("--size", default="128x96")
    parser.add_argument("--guide", default="gaussian")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for scene in args.scenes:
            measure(args, scene, Path(folder))


def run(args, *words):
    begun = time.monotonic()
    result = subprocess.run([args.fanal, *map(str, words)], check=True, capture_output=True, text=True)
    return result.stdout, time.monotonic() - begun


def measure(args, scene, folder):
    def learn(output, spp, *more):
        words = ["--guide", args.guide, "--size", args.size, "--spp", spp, "--quiet", "-o", output, *more]
        return run(args, "learn", scene, *words)[1]

    def noise(guide):
        errors = []
        for pair in range(args.pairs):
            pictures = [folder / "a.exr", folder / "b.exr"]
            for number, picture in enumerate(pictures):
                words = ["--load-guide", guide, "--guide", args.guide, "--size", args.size, "--spp", args.spp]
                run(args, "render", scene, *words, "--seed", 2 * pair + number + 1, "--quiet", "-o", picture)
            errors.append(json.loads(run(args, "error", *pictures, "--json")[0])["relmse_trimmed"])
        return sum(errors) / len(errors)

    one, all_of_them, shared = (folder / name for name in ("one.guide", "all.guide", "shared.guide"))
    seconds = [learn(one, args.learn), learn(all_of_them, args.learn * args.parts)]
    parts = [folder / f"{part}.guide" for part in range(1, args.parts + 1)]
    each = [learn(part, args.learn, "--part", f"{k}/{args.parts}") for k, part in enumerate(parts, 1)]
    merging = run(args, "merge", *parts, "-o", shared, "--quiet")[1]
    first, third, second = noise(one), noise(all_of_them), noise(shared)
    print(f"{scene}: one {seconds[0]:.1f} s, noise 1 ({first:.4g})")
    print(f"    {args.parts} parts: {max(each):.1f} s at most and {merging:.1f} s to merge, noise {second / first:.3f}")
    print(f"    one with all samples: {seconds[1]:.1f} s, noise {third / first:.3f}", flush=True)


main()

#!/usr/bin/env python3
"""What a change is worth: several builds of fanal (or one build with several options) on the same scenes, in turns.

    python3 tests/bench/versions.py SCENE_FOLDER... --build before=PATH --build 'after=PATH --roulette off' \\
        [--methods none,gaussian,neural] [--spp 64 | --time 10] [--seeds 4] [--size WxH] [--json FILE] [--mitsuba llvm_ad_rgb]

Each folder holds a scene.xml or scene.json and a reference.exr, and reference_variance.exr where the reference's own noise is known. The first build is the one that others are measured against;
the last one tells all errors, since old versions do not know of the reference's noise. For every scene and method the table has the first build's trimmed relMSE (the mean over the seeds), and of every other build: the ratio of errors
at equal budgets (in brackets without trimming: who finds more rare light has more bright pixels than are trimmed), of CPU seconds, and of errors times CPU seconds, which is about the ratio of errors at equal time where budgets are
samples. Means are geometric over the seeds, which are paired, with the standard error of their logarithm. Only Python's own library is
needed, but with --mitsuba (pip install mitsuba numpy; for llvm_ad_rgb LLVM 19), which needs --time: Mitsuba 3 renders the same scenes
for as long, loading counted, compiling not, and every build's error is given over its, too.
"""

import argparse
import json
import math
import os
import pathlib
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile


def cpu_of_children():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def divided(command):
    """The environment that NAME=VALUE words before a program make, and the other words."""
    words, settings = shlex.split(command), {}
    while "=" in words[0]:
        name, value = words.pop(0).split("=", 1)
        settings[name] = value
    return settings, words


def run(command, scene, method, budget, seed, folder, judge=None):
    """Trimmed relMSE, relMSE and CPU seconds of one render. NAME=VALUE words before the program are its environment. Errors are told by
    the program `judge`, the same one if none."""
    settings, words = divided(command)
    out = folder / "out.exr"
    file = next(path for path in (scene / "scene.xml", scene / "scene.json") if path.exists())
    before = cpu_of_children()
    render = [words[0], "render", file, "-o", out, "--guide", method, "--seed", seed, "--quiet", *budget, *words[1:]]
    subprocess.run(list(map(str, render)), check=True, env={**os.environ, **settings})
    cpu = cpu_of_children() - before
    return {**error(judge or words[0], out, scene), "cpu": cpu}


def error(fanal, picture, scene):
    """Trimmed relMSE and relMSE of a picture, without the reference's own noise where that is known."""
    words, variance = [fanal, "error", picture, scene / "reference.exr", "--json"], scene / "reference_variance.exr"
    words += ["--reference-variance", variance] if variance.exists() else []
    found = json.loads(subprocess.run(list(map(str, words)), check=True, capture_output=True).stdout)
    return {"trimmed": found["relmse_trimmed"], "all": found["relmse"]}


# Renders in parts for as long as there is time, since what a part takes is only known once one was rendered.
MITSUBA = r"""
import sys, time
import mitsuba as mi
mi.set_variant(sys.argv[1])
import numpy as np
mi.set_log_level(mi.LogLevel.Error)
begun = time.perf_counter()
scene = mi.load_file(sys.argv[2])
loaded = time.perf_counter() - begun
seconds, seed, out = float(sys.argv[3]) - loaded, int(sys.argv[4]), sys.argv[5]
integrator = mi.load_dict({"type": "path", "max_depth": 20})
part = 16
render = lambda number: np.array(mi.render(scene, integrator=integrator, spp=part, seed=100000 * seed + number))[..., :3]
render(99999)
begun, sums, parts, slowest = time.perf_counter(), 0.0, 0, 0.0
while parts == 0 or time.perf_counter() - begun + slowest < seconds:
    before = time.perf_counter()
    sums, parts = sums + render(parts), parts + 1
    slowest = max(slowest, time.perf_counter() - before)
mi.util.write_bitmap(out, mi.TensorXf((sums / parts).astype(np.float32)), write_async=False)
print(part * parts)
"""


def mitsuba(variant, fanal, scene, seconds, seed, folder):
    """Errors of a render of so many seconds as `error` has them, and its samples per pixel."""
    out = folder / "peer.exr"
    words = [sys.executable, "-c", MITSUBA, variant, scene / "scene.xml", seconds, seed, out]
    spp = int(subprocess.run(list(map(str, words)), check=True, capture_output=True, text=True).stdout)
    return error(fanal, out, scene), spp


def ratio(pairs):
    """Geometric mean of ratios, and the standard error of its logarithm."""
    logs = [math.log(after / before) for before, after in pairs]
    error = statistics.stdev(logs) / math.sqrt(len(logs)) if len(logs) > 1 else math.nan
    return math.exp(statistics.mean(logs)), error


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("--build", action="append", required=True, metavar="NAME=COMMAND")
    parser.add_argument("--methods", default="none,gaussian,neural")
    parser.add_argument("--spp", type=int)
    parser.add_argument("--time", type=float)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--size")
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--mitsuba", metavar="VARIANT")
    args = parser.parse_args()
    if args.mitsuba and not args.time:
        parser.error("--mitsuba needs --time")
    builds = [build.split("=", 1) for build in args.build]
    budget = ["--time", args.time] if args.time else ["--spp", args.spp or 64]
    budget += ["--size", args.size] if args.size else []
    sums, rows, judge = {}, [], divided(builds[-1][1])[1][0]
    print("scene method | trimmed relMSE | per build: error +- standard error of its logarithm (untrimmed), CPU, error x CPU")
    for scene in args.scenes:
        peer = []
        with tempfile.TemporaryDirectory() as folder:
            for seed in range(1, args.seeds + 1) if args.mitsuba else ():
                peer.append(mitsuba(args.mitsuba, judge, scene, args.time, seed, pathlib.Path(folder)))
        if peer:
            print(f"{scene.name:14} mitsuba  | {statistics.mean(found['trimmed'] for found, _ in peer):.3g} ({peer[0][1]} spp)", flush=True)
        for method in args.methods.split(","):
            runs = {name: [] for name, _ in builds}
            with tempfile.TemporaryDirectory() as folder:
                for seed in range(1, args.seeds + 1):
                    for name, command in builds if seed % 2 else reversed(builds):
                        runs[name].append(run(command, scene, method, budget, seed, pathlib.Path(folder), judge))
            first = runs[builds[0][0]]
            cells = [f"{statistics.mean(r['trimmed'] for r in first):.3g} ({statistics.mean(r['cpu'] for r in first):.1f} s)"]
            for name, _ in builds[1:]:
                of = lambda what: ratio([(what(a), what(b)) for a, b in zip(first, runs[name])])
                (error, spread), (cpu, _) = of(lambda r: r["trimmed"]), of(lambda r: r["cpu"])
                untrimmed, _ = of(lambda r: r["all"])
                cells.append(f"{name} {error:.3f} +-{spread:.3f} ({untrimmed:.3f}), {cpu:.3f}, {error * cpu:.3f}")
                sums.setdefault((method, name), []).append((error, cpu))
            if peer:
                over = [ratio([(p[0]["trimmed"], r["trimmed"]) for p, r in zip(peer, runs[name])])[0] for name, _ in builds]
                cells.append("over mitsuba " + ", ".join(f"{x:.2f}" for x in over))
            rows.append({"scene": scene.name, "method": method, "runs": runs, "mitsuba": peer})
            print(f"{scene.name:14} {method:9}| " + " | ".join(cells), flush=True)
    for (method, name), values in sums.items():
        error, cpu = (math.exp(statistics.mean(math.log(v[i]) for v in values)) for i in (0, 1))
        print(f"{'geometric mean':14} {method:9}| {name} {error:.3f}, {cpu:.3f}, {error * cpu:.3f}")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""How fast plain path tracing is beside Mitsuba 3, on the same scenes.

Development only: needs `pip install mitsuba numpy` (for llvm_ad_rgb also LLVM's shared library) and a release build of fanal.

    python3 tests/bench/peer.py SCENE_FOLDER... [--rounds 5] [--seconds 30] [--seeds 2] [--variants scalar_rgb,llvm_ad_rgb] [--fanal PATH] [--avx2]

Each folder holds a scene.xml and, for errors, a reference.exr with the scene's own filter. With `--avx2` nobody uses vectors wider than
those of AVX2. Two tables are printed:

- samples per CPU second at the scene's depth without Russian roulette: ours is the difference of two renders, so that loading does not
  count; the peer's is measured inside its process after a first render, so that compiling does not count. Interleaved, medians.
- trimmed relMSE after equal CPU seconds with everybody's defaults (roulette, sampling of lights, sequences of numbers), loading and
  compiling left out for both.
"""

import argparse
import json
import math
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
FANAL = ROOT / "target/release/fanal"
DEPTH = 20


def cpu_of_children():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def fanal(scene, out, *options):
    """CPU seconds of one render, and its statistics."""
    stats = pathlib.Path(out).with_suffix(".json")
    before = cpu_of_children()
    command = [FANAL, "render", scene, "-o", out, "--guide", "none", "--max-depth", str(DEPTH), "--stats", stats, "--quiet"]
    subprocess.run([*map(str, command), *map(str, options)], check=True)
    return cpu_of_children() - before, json.loads(stats.read_text())


# The peer lives in a process of its own, one per variant: it reads commands from standard input.
PEER = r"""
import sys, time, json
import mitsuba as mi
mi.set_variant(sys.argv[1])
if sys.argv[3] == "avx2":
    import ctypes, glob, os
    import drjit
    [core] = glob.glob(os.path.join(os.path.dirname(drjit.__file__), "libdrjit-core.*"))
    # There is no Python for it: jit_llvm_set_target(cpu, features, width).
    ctypes.CDLL(core)["_Z19jit_llvm_set_targetPKcS0_j"](b"x86-64-v3", None, 8)
import numpy as np
mi.set_log_level(mi.LogLevel.Error)
scene = mi.load_file(sys.argv[2])
for line in sys.stdin:
    job = json.loads(line)
    integrator = {"type": "path", "max_depth": job["depth"]}
    if not job["roulette"]:
        integrator["rr_depth"] = 1000
    integrator = mi.load_dict(integrator)
    left, sums, done, seed = job["spp"], 0.0, 0, job["seed"]
    begun = time.process_time()
    while left > 0:
        # In parts, since a wavefront holds all of its samples in memory.
        part = min(left, job["part"])
        image = np.array(mi.render(scene, integrator=integrator, spp=part, seed=seed))[..., :3]
        sums, done, left, seed = sums + image * part, done + part, left - part, seed + 1
    seconds = time.process_time() - begun
    if job.get("out"):
        mi.util.write_bitmap(job["out"], mi.TensorXf((sums / done).astype(np.float32)), write_async=False)
    print(json.dumps({"seconds": seconds, "height": image.shape[0], "width": image.shape[1]}), flush=True)
"""


class Peer:
    def __init__(self, variant, scene, vectors):
        self.process = subprocess.Popen(
            [sys.executable, "-c", PEER, variant, str(scene), vectors], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def render(self, spp, roulette, seed, out=None, part=64):
        job = {"depth": DEPTH, "spp": spp, "roulette": roulette, "seed": seed, "out": out and str(out), "part": part}
        self.process.stdin.write(json.dumps(job) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        return answer["seconds"], answer["width"] * answer["height"]

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def speed(scene, peers, rounds, folder):
    """Samples per CPU second, in millions, by name."""
    found = {name: [] for name in ["fanal", *peers]}
    for name, peer in peers.items():
        peer.render(2, False, 0)
    for seed in range(1, rounds + 1):
        options = ["--roulette", "off", "--seed", seed]
        few, _ = fanal(scene, folder / "a.exr", *options, "--spp", 2)
        many, stats = fanal(scene, folder / "a.exr", *options, "--spp", 34)
        found["fanal"].append(32 * stats["width"] * stats["height"] / (many - few) / 1e6)
        for name, peer in peers.items():
            spp = 4 if name.startswith("scalar") else 32
            seconds, pixels = peer.render(spp, False, seed)
            found[name].append(spp * pixels / seconds / 1e6)
    return {name: statistics.median(values) for name, values in found.items()}


def errors(scene, peers, seconds, seeds, folder):
    """Trimmed relMSE by name, geometric means over seeds."""
    reference = scene.parent / "reference.exr"

    def trimmed(picture):
        result = subprocess.run([FANAL, "error", picture, reference, "--json"], check=True, capture_output=True, text=True)
        return json.loads(result.stdout)["relmse_trimmed"]

    found = {name: [] for name in ["fanal", *peers]}
    spp = {}
    for seed in range(1, seeds + 1):
        if "fanal" not in spp:
            few, _ = fanal(scene, folder / "a.exr", "--spp", 2)
            many, _ = fanal(scene, folder / "a.exr", "--spp", 34)
            spp["fanal"] = max(1, round(32 * seconds / (many - few)))
        fanal(scene, folder / "a.exr", "--seed", seed, "--spp", spp["fanal"])
        found["fanal"].append(trimmed(folder / "a.exr"))
        for name, peer in peers.items():
            if name not in spp:
                peer.render(4, True, 0)
                spent, _ = peer.render(16, True, 0)
                spp[name] = max(1, round(16 * seconds / spent))
            peer.render(spp[name], True, 1000 * seed, folder / "b.exr")
            found[name].append(trimmed(folder / "b.exr"))
    mean = lambda values: math.exp(sum(map(math.log, values)) / len(values))
    return {name: (mean(values), spp[name]) for name, values in found.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=30, help="CPU seconds for errors; 0 leaves them out")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--variants", default="scalar_rgb,llvm_ad_rgb")
    parser.add_argument("--fanal", type=pathlib.Path, default=FANAL, help="the build to measure")
    parser.add_argument("--avx2", action="store_true", help="no wider vectors than those of AVX2, for anybody")
    options = parser.parse_args()
    vectors = "avx2" if options.avx2 else "any"
    if options.avx2:
        os.environ["FANAL_LANES"] = "avx2"
    globals()["FANAL"] = options.fanal
    variants = [variant for variant in options.variants.split(",") if variant]
    ratios = {variant: [] for variant in variants}
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for place in options.scenes:
            scene = place / "scene.xml" if place.is_dir() else place
            peers = {variant: Peer(variant, scene, vectors) for variant in variants}
            if options.rounds:
                rates = speed(scene, peers, options.rounds, folder)
                text = "  ".join(f"{name} {rate:.3f}" for name, rate in rates.items())
                over = "  ".join(f"{rates['fanal'] / rates[v]:.2f} x {v}" for v in variants)
                print(f"{place.name:14} million samples per CPU second: {text}  |  {over}", flush=True)
                for variant in variants:
                    ratios[variant].append(rates["fanal"] / rates[variant])
            if options.seconds:
                found = errors(scene, peers, options.seconds, options.seeds, folder)
                text = "  ".join(f"{name} {error:.3g} ({spp} spp)" for name, (error, spp) in found.items())
                over = "  ".join(f"{found['fanal'][0] / found[v][0]:.2f} x {v}" for v in variants)
                print(f"{place.name:14} trimmed relMSE after {options.seconds:g} CPU s: {text}  |  {over}", flush=True)
            for peer in peers.values():
                peer.close()
    for variant, values in ratios.items():
        if values:
            mean = math.exp(sum(map(math.log, values)) / len(values))
            print(f"geometric mean over {len(values)} scenes: {mean:.2f} x the samples per CPU second of {variant}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""fanal beside Mitsuba 3 on scenes that nobody chose: drawn by the generator's recipes with a seed of their own, which no network was trained on.

    pip install mitsuba numpy OpenEXR          (for llvm_ad_rgb LLVM 19, too)
    python3 tests/bench/unseen.py OUT [--recipes default,interiors,glazed,beams] [--seed 991] [--scenes 1] [--size 256] [--time 8] [--seeds 2]
        [--methods none,neural] [--mitsuba llvm_ad_rgb] [--fanal FANAL]

Every scene is written as Mitsuba's XML (as_mitsuba.py), which both read; those with media are left out. No reference is needed: half of the squared
difference of two seeds is the variance of one. The table has for each method the mean over pixels of variance over (squared mean of all pictures
+ 1 % of the mean of that), without the worst 0.1 % (in brackets with them), over that of Mitsuba; and the mean of its pictures over that of Mitsuba's,
which also tells whether the reader reads what Mitsuba does. Pictures in OUT are not made again.
"""

import argparse
import itertools
import math
import pathlib
import re
import statistics
import subprocess
import sys

import numpy as np

import as_mitsuba
from noise import noise, read
from versions import MITSUBA

ROOT = pathlib.Path(__file__).resolve().parents[2]
PEER = "mitsuba"


def drawn(args):
    """Folders of Mitsuba scenes by name."""
    found = {}
    for recipe in args.recipes.split(","):
        given = (ROOT / "datasets" / f"{recipe}.toml").read_text()
        changes = {"seed": args.seed, "resolution": [args.size, args.size], "scenes": args.scenes}
        for key, value in changes.items():
            given = re.sub(rf"^{key} *=.*", f"{key} = {value}", given, flags=re.MULTILINE)
        (args.out / f"{recipe}.toml").write_text(given)
        data = args.out / "data" / recipe
        subprocess.run(list(map(str, [args.fanal, "dataset", args.out / f"{recipe}.toml", "--only-scenes", "-o", data])), check=True, capture_output=True)
        for scene in sorted(path.parent for path in data.rglob("scene.json")):
            name = re.sub(r"-[0-9a-f]{16}$", "", scene.name)
            converted = subprocess.run([sys.executable, as_mitsuba.__file__, scene, args.out / "scenes" / name])
            if converted.returncode == 0:
                found[name] = args.out / "scenes" / name
            elif converted.returncode != as_mitsuba.NOT_ALIKE:
                sys.exit(f"{scene} was not converted")
    return found


def render(args, scene, method, seed, out):
    if out.exists():
        return
    words = [args.fanal, "render", scene / "scene.xml", "-o", out, "--guide", method, "--time", args.time, "--seed", seed, "--quiet"]
    if method == PEER:
        words = [sys.executable, "-c", MITSUBA, args.mitsuba, scene / "scene.xml", args.time, seed, out]
    subprocess.run(list(map(str, words)), check=True, capture_output=True)


def variances(pictures, square):
    """Trimmed (geometric mean over pairs of seeds) and whole relative variance of one picture."""
    whole, logs = noise(pictures, square)
    return np.exp(logs[np.triu_indices(len(pictures), 1)].mean()), whole


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--recipes", default="default,interiors,glazed,beams")
    parser.add_argument("--seed", type=int, default=991)
    parser.add_argument("--scenes", type=int, default=1)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--time", type=float, default=8.0)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--methods", default="none,neural")
    parser.add_argument("--mitsuba", default="llvm_ad_rgb", metavar="VARIANT")
    parser.add_argument("--fanal", default=str(ROOT / "target/release/fanal"))
    args = parser.parse_args()
    if args.seeds < 2:
        parser.error("the variance of one seed is not known")
    args.out.mkdir(parents=True, exist_ok=True)
    methods, seeds = [PEER, *args.methods.split(",")], range(1, args.seeds + 1)
    logs = {method: [] for method in methods[1:]}
    print("| | " + " | ".join(f"`{method}`" for method in methods[1:]) + " | means over Mitsuba's |")
    print("|---" * (len(methods) + 1) + "|")
    for name, scene in drawn(args).items():
        picture = lambda method, seed: args.out / f"{name}-{method}-{seed}.exr"
        for seed, method in itertools.product(seeds, methods):
            render(args, scene, method, seed, picture(method, seed))
        pictures = {method: [read(picture(method, seed)) for seed in seeds] for method in methods}
        means = {method: np.mean(of) for method, of in pictures.items()}
        mean = np.mean([np.mean(of, 0) for of in pictures.values()], 0)
        square = np.mean(mean**2 + 0.01 * np.mean(mean) ** 2, -1)
        found = {method: variances(of, square) for method, of in pictures.items()}
        over = {method: [ours / peers for ours, peers in zip(found[method], found[PEER])] for method in methods[1:]}
        for method, (trimmed, _) in over.items():
            logs[method].append(math.log(trimmed))
        cells = [f"{trimmed:.2g} ({whole:.2g})" for trimmed, whole in over.values()]
        print(f"| `{name}` | " + " | ".join(cells) + " | " + ", ".join(f"{means[method] / means[PEER]:.3f}" for method in over) + " |", flush=True)
    print("| geometric mean | " + " | ".join(f"{math.exp(statistics.mean(all_)):.2f}" for all_ in logs.values()) + " | |")


if __name__ == "__main__":
    sys.exit(main())

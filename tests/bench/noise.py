#!/usr/bin/env python3
"""Noise of the methods of a comparison, from the differences between its seeds: no reference is needed.

    pip install numpy OpenEXR
    cargo run --release -- compare scenes/spot --methods gaussian,neural --time 30 --seeds 3 --reference-spp 8 -o out/spot
    tests/bench/noise.py out/spot out/...

All methods have the same mean, so half of the squared difference of two seeds is the variance of one. Prints for each folder and
budget every method's variance over (mean squared + 0.01), averaged over pixels, with and without the worst 0.1 % of them, and the
trimmed one over that of the first method; at the end the geometric mean of the ratios over folders.
"""
import itertools
import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import OpenEXR

TRIMMED = 0.999
OFFSET = 0.01


def read(path):
    channels = OpenEXR.File(str(path)).channels()
    if "RGB" in channels:
        return np.asarray(channels["RGB"].pixels, np.float64)
    return np.stack([np.asarray(channels[c].pixels, np.float64) for c in "RGB"], -1)


def noise(pictures, square):
    """Relative variance over all pixels, and the geometric mean over pairs of seeds of the trimmed one."""
    whole, trimmed = [], []
    for a, b in itertools.combinations(pictures, 2):
        error = np.sort((np.mean((a - b) ** 2, -1) / 2 / square).ravel())
        whole.append(error.mean())
        trimmed.append(error[: int(len(error) * TRIMMED)].mean())
    return np.mean(whole), np.exp(np.mean(np.log(trimmed)))


def main(folders):
    ratios = defaultdict(list)
    for folder in map(Path, folders):
        results = json.loads((folder / "results.json").read_text())
        for budget, limit in enumerate(results["budgets"]):
            pictures = {
                method: [read(folder / run["file"]) for run in results["runs"]
                         if run["method"] == method and run["budget"] == budget]
                for method in results["methods"]
            }
            if any(len(of) < 2 for of in pictures.values()):
                sys.exit(f"{folder}: every method needs two seeds")
            mean = np.mean([np.mean(of, 0) for of in pictures.values()], 0)
            square = np.mean(mean, -1) ** 2 + OFFSET
            found = {method: noise(of, square) for method, of in pictures.items()}
            first = found[results["methods"][0]][1]
            for method, (whole, trimmed) in found.items():
                print(f"{folder.name:16} {json.dumps(limit):18} {method:10} {whole:10.6f} {trimmed:10.6f} {trimmed / first:6.3f}")
                ratios[method].append(np.log(trimmed / first))
    for method, of in ratios.items():
        print(f"{'geometric mean':35} {method:10} {'':21} {np.exp(np.mean(of)):6.3f}")


if __name__ == "__main__":
    main(sys.argv[1:])

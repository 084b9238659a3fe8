#!/usr/bin/env python3
"""Noise of the methods of a comparison, from the differences between its seeds: no reference is needed.

    pip install numpy OpenEXR
    cargo run --release -- compare scenes/spot --methods gaussian,neural --time 30 --seeds 8 --reference-spp 8 -o out/spot
    tests/bench/noise.py out/spot out/...

All methods have the same mean, so half of the squared difference of two seeds is the variance of one. Prints for each folder and
budget every method's variance over (mean squared + 0.01), averaged over pixels, with and without the worst 0.1 % of them, and the
trimmed one over that of the first method with a 95 % interval (bootstrap over seeds, which are paired; from five seeds on); at the
end the geometric mean of the ratios over folders, whose interval draws the seeds of each folder by themselves.
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
RESAMPLED = 2000
FEWEST = 5


def read(path):
    channels = OpenEXR.File(str(path)).channels()
    if "RGB" in channels:
        return np.asarray(channels["RGB"].pixels, np.float64)
    return np.stack([np.asarray(channels[c].pixels, np.float64) for c in "RGB"], -1)


def noise(pictures, square):
    """Relative variance over all pixels, and the logarithm of the trimmed one for each pair of seeds [seeds, seeds]."""
    whole, trimmed = [], np.zeros((len(pictures), len(pictures)))
    for a, b in itertools.combinations(range(len(pictures)), 2):
        error = np.sort((np.mean((pictures[a] - pictures[b]) ** 2, -1) / 2 / square).ravel())
        whole.append(error.mean())
        trimmed[a, b] = trimmed[b, a] = np.log(error[: int(len(error) * TRIMMED)].mean())
    return np.mean(whole), trimmed


def mean_of_pairs(values, times):
    """Mean over pairs of different seeds, a seed counted `times[...]` often."""
    weight = times[:, None] * times[None, :] * (1 - np.eye(len(times)))
    return (values * weight).sum() / weight.sum()


def resampled(values, rng):
    """Bootstrap of the mean over pairs: how often each seed is drawn, as long as two different ones are."""
    seeds = len(values)
    while True:
        times = np.bincount(rng.integers(seeds, size=seeds), minlength=seeds)
        if np.count_nonzero(times) > 1:
            return mean_of_pairs(values, times)


def interval(draws):
    low, high = np.exp(np.percentile(draws, [2.5, 97.5]))
    return f"[{low:.3f}, {high:.3f}]"


def main(folders):
    ratios, draws = defaultdict(list), defaultdict(list)
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
            every = np.ones(len(first))
            for method, (whole, trimmed) in found.items():
                own, ratio = (np.exp(mean_of_pairs(of, every)) for of in (trimmed, trimmed - first))
                rng = np.random.default_rng(1)
                drawn = [resampled(trimmed - first, rng) for _ in range(RESAMPLED)]
                between = interval(drawn) if len(first) >= FEWEST else ""
                print(f"{folder.name:16} {json.dumps(limit):18} {method:10} {whole:10.6f} {own:10.6f} {ratio:6.3f} {between}")
                ratios[method].append(np.log(ratio))
                # Each folder's draws in an order of their own: its seeds have nothing to do with another folder's.
                draws[method].append(np.random.default_rng(len(draws[method])).permutation(drawn))
    for method, of in ratios.items():
        between = interval(np.mean(draws[method], 0))
        print(f"{'geometric mean':35} {method:10} {'':21} {np.exp(np.mean(of)):6.3f} {between}")


if __name__ == "__main__":
    main(sys.argv[1:])

#!/usr/bin/env python3
"""Plain path tracing at the number of samples that Mitsuba made in its time: the ratio of the errors, evenly divided and adaptive.

    python3 docs/remake OUT --scenes FOLDER --times 10
    python3 tests/bench/per_sample.py OUT/equal-10.json FOLDER [--seed 1]

Reads what Mitsuba reached from the first command's results. FOLDER holds the scenes, each with scene.xml and reference.exr.
"""

import argparse
import json
import math
import pathlib
import subprocess
import tempfile

FANAL = pathlib.Path(__file__).resolve().parents[2] / "target/release/fanal"


def error(scene, spp, adaptive, seed):
    with tempfile.TemporaryDirectory() as folder:
        statistics = pathlib.Path(folder) / "statistics.json"
        words = [FANAL, "render", scene, "--guide", "none", "--spp", spp, "--adaptive", adaptive, "--seed", seed, "--quiet"]
        words += ["-o", f"{folder}/picture.exr", "--reference", scene / "reference.exr", "--stats", statistics]
        subprocess.run(list(map(str, words)), check=True)
        return json.loads(statistics.read_text())["errors"][-1]["relmse_trimmed"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=pathlib.Path)
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("--seed", default="1")
    args = parser.parse_args()
    peers = {row["scene"]: row["mitsuba"][0] for row in json.loads(args.results.read_text())}
    ratios = {"off": [], "on": []}
    for scene, (peer, spp) in peers.items():
        for adaptive, found in ratios.items():
            found.append(error(args.scenes / scene, spp, adaptive, args.seed) / peer)
        print(f"{scene:<16} {spp:>5} spp   even {ratios['off'][-1]:.2f}   adaptive {ratios['on'][-1]:.2f}", flush=True)
    means = [math.exp(sum(map(math.log, found)) / len(found)) for found in ratios.values()]
    print(f"geometric mean: even {means[0]:.2f}, adaptive {means[1]:.2f}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Plain path tracing at the number of samples that Mitsuba made in its time: the ratio of the errors, evenly divided and adaptive.

    python3 tests/bench/equal_time.py SCENE_FOLDER... --journal FILE --mitsuba llvm_ad_rgb --time 10
    python3 tests/bench/per_sample.py FILE FOLDER [--time 10] [--seeds 1]

Reads what Mitsuba reached from the first command's journal. FOLDER holds the scenes, each with scene.xml and reference.exr.
"""

import argparse
import math
import pathlib
import statistics
import tempfile

from equal_time import PEER, Journal
from versions import run

FANAL = pathlib.Path(__file__).resolve().parents[2] / "target/release/fanal"


def error(scene, spp, adaptive, seed):
    with tempfile.TemporaryDirectory() as folder:
        budget = ["--spp", spp, "--adaptive", adaptive]
        return run(str(FANAL), scene, "none", budget, seed, pathlib.Path(folder))["trimmed"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("journal", type=pathlib.Path)
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("--time", type=float, default=10)
    parser.add_argument("--seeds", type=int, default=1)
    args = parser.parse_args()
    journal, ratios = Journal(args.journal), {"off": [], "on": []}
    for scene in journal.scenes():
        for adaptive, found in ratios.items():
            peers = [journal.rows[scene, PEER, args.time, seed] for seed in range(1, args.seeds + 1)]
            errors = [error(args.scenes / scene, peer["spp"], adaptive, peer["seed"]) / peer["trimmed"] for peer in peers]
            found.append(math.exp(statistics.mean(map(math.log, errors))))
        print(f"{scene:<16} {peers[0]['spp']:>5} spp   even {ratios['off'][-1]:.2f}   adaptive {ratios['on'][-1]:.2f}", flush=True)
    means = [math.exp(sum(map(math.log, found)) / len(found)) for found in ratios.values()]
    print(f"geometric mean: even {means[0]:.2f}, adaptive {means[1]:.2f}")


if __name__ == "__main__":
    main()

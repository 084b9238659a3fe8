#!/usr/bin/env python3
"""Our scenes full of fog, or of clouds, to measure distances and complete paths in media on.

    python3 tests/bench/fog.py OUT [--cloud]      writes OUT/spot, OUT/door-ajar and OUT/lamp-room, each with a scene.json

Clouds are patches on a grid of 16³ cells over the scene that has the mean extinction of the fog. Only Python's own library is needed.
"""

import argparse
import json
import math
import pathlib
import shutil

SCENES = pathlib.Path(__file__).resolve().parents[2] / "scenes"
# Extinction of the fog, 1 / scene unit: rooms are 2 to 5 units large.
FOG = {"spot": 0.15, "door-ajar": 0.2, "lamp-room": 0.3}
CELLS = 16


def patches():
    """Values around 1 in smooth patches, a quarter of them 0."""
    wave = lambda x, y, z: math.sin(1.8 * x + 0.8 * z) + math.sin(1.4 * y - x) + math.sin(1.6 * z + 0.6 * y)
    values = [max(0.0, 1.0 + wave(x, y, z)) for z in range(CELLS) for y in range(CELLS) for x in range(CELLS)]
    mean = sum(values) / len(values)
    return [round(value / mean, 3) for value in values]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--cloud", action="store_true")
    args = parser.parse_args()
    for name, extinction in FOG.items():
        out = args.out / name
        shutil.copytree(SCENES / name, out, ignore=shutil.ignore_patterns("*.png", "plots"), dirs_exist_ok=True)
        scene = json.loads((out / "scene.json").read_text())
        medium = {"type": "homogeneous", "sigma_t": [extinction] * 3, "albedo": [0.9, 0.92, 0.95], "g": 0.3}
        if args.cloud:
            # Around all three rooms.
            side, low = 12.0, -4.0
            to_world = [side, 0, 0, low, 0, side, 0, low, 0, 0, side, low, 0, 0, 0, 1]
            density = {"type": "inline", "size": [CELLS] * 3, "values": patches(), "to_world": to_world}
            medium = {**medium, "type": "grid", "density": density}
        scene["media"] = {"fog": medium}
        # Lights and shapes of no stated medium are in the camera's.
        scene["camera"]["medium"] = "fog"
        (out / "scene.json").write_text(json.dumps(scene, indent=1) + "\n")


main()

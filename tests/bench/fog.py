#!/usr/bin/env python3
"""Our scenes full of fog, to measure distances in media on.

    python3 tests/bench/fog.py OUT        writes OUT/spot, OUT/door-ajar and OUT/lamp-room, each with a scene.json

Only Python's own library is needed.
"""

import json
import pathlib
import shutil
import sys

SCENES = pathlib.Path(__file__).resolve().parents[2] / "scenes"
# Extinction of the fog, 1 / scene unit: rooms are 2 to 5 units large.
FOG = {"spot": 0.15, "door-ajar": 0.2, "lamp-room": 0.3}


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    for name, extinction in FOG.items():
        out = pathlib.Path(sys.argv[1]) / name
        shutil.copytree(SCENES / name, out, ignore=shutil.ignore_patterns("*.png", "plots"), dirs_exist_ok=True)
        scene = json.loads((out / "scene.json").read_text())
        scene["media"] = {"fog": {"type": "homogeneous", "sigma_t": [extinction] * 3, "albedo": [0.9, 0.92, 0.95], "g": 0.3}}
        # Lights and shapes of no stated medium are in the camera's.
        scene["camera"]["medium"] = "fog"
        (out / "scene.json").write_text(json.dumps(scene, indent=1) + "\n")


main()

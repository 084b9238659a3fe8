#!/usr/bin/env python3
"""Scenes of many lamps of which most bring nothing: a flat of six rooms with 30 lamps, a street among others with 198, and a hall under
144 spots.

    python3 tests/bench/lamps.py OUT        writes OUT/flat/scene.json, OUT/street/scene.json and OUT/hall/scene.json

Only Python's own library is needed.
"""

import json
import math
import pathlib
import random
import sys


def look_at(origin, target):
    """The camera's matrix, upright."""
    unit = lambda v: [c / math.sqrt(sum(d * d for d in v)) for c in v]
    cross = lambda a, b: [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    ahead = unit([b - a for a, b in zip(origin, target)])
    aside = unit(cross((0, 1, 0), ahead))
    upwards = cross(ahead, aside)
    return [v for r in range(3) for v in (aside[r], upwards[r], ahead[r], origin[r])] + [0, 0, 0, 1]


class Scene:
    def __init__(self, name, size, camera, fov, depth):
        self.file = {
            "version": 1, "name": name, "camera": {"to_world": camera, "fov": fov},
            "film": {"width": size[0], "height": size[1]}, "render": {"max_depth": depth, "spp": 64}, "materials": {},
            "meshes": {"cube": {"type": "cube"}, "square": {"type": "rectangle"}}, "shapes": [], "lights": [],
        }

    def colour(self, name, value):
        material = {"type": "diffuse", "reflectance": {"type": "rgb", "value": value}}
        self.file["materials"][name] = {"type": "two_sided", "material": material}

    def shape(self, geometry, material, to_world=None, emission=None):
        shape = {"name": material, "geometry": geometry, "material": material}
        if to_world:
            shape["to_world"] = to_world
        if emission:
            shape["emission"] = emission
        self.file["shapes"].append(shape)

    def block(self, low, high, material):
        (x, y, z), (a, b, c) = [(a + b) / 2 for a, b in zip(low, high)], [(b - a) / 2 for a, b in zip(low, high)]
        self.shape({"type": "mesh", "mesh": "cube"}, material, [a, 0, 0, x, 0, b, 0, y, 0, 0, c, z, 0, 0, 0, 1])

    def panel(self, at, half, emission):
        """A square that shines downwards."""
        (x, y, z), (a, c) = at, half
        to_world = [a, 0, 0, x, 0, 0, -1, y, 0, c, 0, z, 0, 0, 0, 1]
        self.shape({"type": "mesh", "mesh": "square"}, "lamp", to_world, emission)

    def bulb(self, at, radius, emission):
        self.shape({"type": "sphere", "center": at, "radius": radius}, "lamp", emission=emission)

    def write(self, folder):
        folder = pathlib.Path(folder) / self.file["name"]
        folder.mkdir(parents=True, exist_ok=True)
        file = {key: value for key, value in self.file.items() if key != "lights" or value}
        (folder / "scene.json").write_text(json.dumps(file, indent=1) + "\n")


def flat(numbers):
    """Three by two rooms of 4 × 4 m behind doors, of which one is ajar, with five lamps each."""
    scene = Scene("flat", (256, 192), look_at((0.3, 1.6, 0.3), (2.6, 0.9, 2.8)), 75, 12)
    for name, value in [("plaster", [0.72, 0.7, 0.66]), ("floor", [0.35, 0.25, 0.17]), ("wood", [0.42, 0.27, 0.14]),
                        ("cloth", [0.2, 0.28, 0.45]), ("lamp", [0.6, 0.6, 0.6])]:
        scene.colour(name, value)
    side, height, half = 4.0, 2.5, 0.05
    scene.block((-0.1, -0.1, -0.1), (3 * side + 0.1, 0, 2 * side + 0.1), "floor")
    scene.block((-0.1, height, -0.1), (3 * side + 0.1, height + 0.1, 2 * side + 0.1), "plaster")
    for i in range(4):
        x = i * side
        for j in range(2):
            z = j * side
            if i in (0, 3):
                scene.block((x - half, 0, z), (x + half, height, z + side), "plaster")
                continue
            scene.block((x - half, 0, z), (x + half, height, z + 1.5), "plaster")
            scene.block((x - half, 0, z + 2.4), (x + half, height, z + side), "plaster")
            scene.block((x - half, 2.05, z + 1.5), (x + half, height, z + 2.4), "plaster")
            gap = 0.25 if (i, j) == (1, 0) else 0
            scene.block((x - 0.02, 0, z + 1.5 + gap), (x + 0.02, 2.05, z + 2.4), "wood")
    for j in range(3):
        scene.block((-half, 0, j * side - half), (3 * side + half, height, j * side + half), "plaster")
    for x, z in [(i * side, j * side) for i in range(3) for j in range(2)]:
        scene.panel((x + 2, height - 0.02, z + 2), (0.25, 0.25), [12, 11, 9])
        for aside in (3.7, 0.3):
            at = [x + numbers.uniform(0.5, 3.5), numbers.uniform(1.2, 1.8), z + aside]
            scene.bulb(at, 0.06, [40, 32, 20])
        light = {"type": "point", "position": [x + 3.4, 1.2, z + 3.3], "intensity": [2.0, 1.6, 1.1]}
        scene.file["lights"].append(light)
        shelf = x + numbers.uniform(0.6, 2.8)
        scene.block((shelf, 1.5, z + 3.6), (shelf + 0.8, 1.54, z + 3.95), "wood")
        scene.panel((shelf + 0.4, 1.49, z + 3.75), (0.3, 0.03), [20, 18, 15])
        scene.block((x + 1.2, 0.7, z + 1.4), (x + 2.6, 0.75, z + 2.4), "wood")
        for a, b in [(1.25, 1.45), (2.5, 1.45), (1.25, 2.3), (2.5, 2.3)]:
            scene.block((x + a, 0, z + b), (x + a + 0.06, 0.7, z + b + 0.06), "wood")
        scene.block((x + 2.7, 0, z + 3.0), (x + 3.9, 0.45, z + 3.9), "cloth")
        scene.block((x + 0.06, 0, z + 2.6), (x + 0.5, 1.0, z + 3.5), "wood")
    return scene


def street(numbers):
    """Nine streets between 48 houses, with 22 street lamps each."""
    scene = Scene("street", (256, 144), look_at((2.0, 1.7, -6), (0.5, 2.5, 30)), 65, 8)
    for name, value in [("asphalt", [0.18, 0.18, 0.19]), ("brick", [0.45, 0.28, 0.22]), ("stone", [0.5, 0.48, 0.44]),
                        ("lamp", [0.5, 0.5, 0.5])]:
        scene.colour(name, value)
    scene.block((-90, -0.2, -30), (90, 0, 170), "asphalt")
    for x, z in [(i * 22 + 5.0, j * 28) for i in range(-4, 4) for j in range(6)]:
        height = numbers.uniform(7, 16)
        scene.block((x, 0, z), (x + 12, height, z + 20), "brick" if numbers.random() < 0.5 else "stone")
    for i in range(-4, 5):
        for k in range(22):
            x, z, aside = i * 22, k * 8.0 - 8, -1 if k % 2 else 1
            scene.panel((x + aside * 3.5, 5.5, z), (0.25, 0.12), [120, 95, 60])
            scene.block((x + aside * 4.0 - 0.05, 0, z - 0.05), (x + aside * 4.0 + 0.05, 5.6, z + 0.05), "stone")
    return scene


def hall(_):
    """A floor and a wall under a grid of spots of 30 degrees, a metre apart and three above the floor."""
    scene = Scene("hall", (160, 120), look_at((0, 2.5, -9), (0, -0.7, 0)), 50, 8)
    scene.colour("stone", [0.5, 0.5, 0.5])
    scene.block((-6, -0.2, -6), (6, 0, 6), "stone")
    scene.block((-6, 0, 6), (6, 3, 6.2), "stone")
    for x, z in [(i - 5.5, j - 5.5) for i in range(12) for j in range(12)]:
        down = [1, 0, 0, x, 0, 0, -1, 3, 0, 1, 0, z, 0, 0, 0, 1]
        spot = {"type": "spot", "to_world": down, "intensity": [3, 3, 3], "cutoff_angle": 30, "beam_width": 20}
        scene.file["lights"].append(spot)
    return scene


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    numbers = random.Random(3)
    for make in (flat, street, hall):
        make(numbers).write(sys.argv[1])


if __name__ == "__main__":
    main()

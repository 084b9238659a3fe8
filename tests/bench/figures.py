#!/usr/bin/env python3
"""Makes the README's picture and those of docs/measurements.md again, and with --time a table of equal times: five minutes of a machine that does nothing else,
with the table about an hour.

    pip install numpy OpenEXR pillow
    cargo build --release
    python3 tests/bench/figures.py OUT [--imported FOLDER] [--time 10 --seeds 4]

Comparisons go to OUT and go on where they were interrupted, so the same command after a change of the program needs another OUT. FOLDER
holds the imported scenes `torus`, `veach-bidir` and `veach-mis`, each with its scene.xml and reference.exr; without it their picture
stays as it is. What is told goes between two comments of docs/measurements.md.
"""

import argparse
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys

import numpy
from noise import read
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
FANAL = ROOT / "target/release/fanal"
SCENES = ROOT / "scenes"
HARD = ["door-ajar", "spot", "lamp-room", "pinhole", "glass-caustic", "blinds"]
OTHERS = ["cornell", "starfield", "white-furnace"]
IMPORTED = ["torus", "veach-bidir", "veach-mis"]
GAP = 4


def fanal(*words):
    subprocess.run([str(word) for word in (FANAL, *words)], check=True)


def compared(scene, out, methods, *options):
    """Means over the seeds by method and budget, of a comparison in `out`."""
    fanal("compare", SCENES / scene, "--methods", ",".join(methods), *options, "-o", out, "--quiet")
    results = json.loads((out / "results.json").read_text())
    return {(row["method"], row["budget"]): row for row in results["summary"]}


def table(out, seconds, seeds):
    """Errors after equal times, as Markdown."""
    rows = ["| scene | `none` | `gaussian` | `neural` | `neural` over `gaussian` |", "|---|---|---|---|---|"]
    gains = []
    for scene in HARD + OTHERS:
        methods = ["none", "gaussian", "neural"]
        options = ["--time", seconds, "--seeds", seeds, "--size", "192x192", "--reference-spp", "768"]
        summary = compared(scene, out / "equal" / scene, methods, *options)
        none, gaussian, neural = (summary[method, 0] for method in methods)
        gain = neural["ratio"]["mean"] / gaussian["ratio"]["mean"]
        gains += [gain] if scene in HARD else []
        told = [f"{row['ratio']['mean']:.2g} [{row['ratio']['low']:.2g}, {row['ratio']['high']:.2g}]" for row in (gaussian, neural)]
        rows.append(f"| `{scene}` | {none['relmse_trimmed']['mean']:.2g} | {told[0]} | {told[1]} | {gain:.2f} |")
    mean = math.exp(sum(map(math.log, gains)) / len(gains))
    rows.append(f"| the first six, geometric mean | | | | {mean:.2f} |")
    return "\n".join(rows)


def side_by_side(rows):
    """Pictures in rows and columns on white, each in the middle of its place."""
    heights = [max(picture.height for picture in row) for row in rows]
    widths = [max(picture.width for picture in column) for column in zip(*rows)]
    whole = Image.new("RGB", (sum(widths) + GAP * (len(widths) - 1), sum(heights) + GAP * (len(heights) - 1)), "white")
    for j, row in enumerate(rows):
        for i, picture in enumerate(row):
            x = sum(widths[:i]) + GAP * i + (widths[i] - picture.width) // 2
            y = sum(heights[:j]) + GAP * j + (heights[j] - picture.height) // 2
            whole.paste(picture, (x, y))
    return whole


def developed(path):
    """An EXR file as sRGB."""
    linear = read(path).clip(0, 1)
    encoded = numpy.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return Image.fromarray((255 * encoded + 0.5).astype(numpy.uint8))


def door(out):
    """The picture of the door: three methods after eight seconds each."""
    shown = []
    for method in ("none", "variance", "neural"):
        picture = out / f"door-{method}.png"
        fanal("render", SCENES / "door-ajar", "--guide", method, "--time", "8", "--seed", "1", "-o", picture, "--quiet")
        shown.append(Image.open(picture).convert("RGB"))
    side_by_side([shown]).save(SCENES / "door-ajar/modes.png", optimize=True)


def easy(out):
    """The plot of the box under a lamp; what the methods have over plain path tracing after the longest and the shortest time."""
    methods = ["none", "variance", "gaussian", "neural"]
    summary = compared("cornell", out / "easy", methods, "--time", "2,4,8", "--seeds", "2", "--reference-spp", "256")
    shutil.copy(out / "easy/plots/relmse-trimmed-seconds.svg", SCENES / "cornell/plots/relmse-trimmed-seconds.svg")
    return [[summary[method, budget]["ratio"]["mean"] for method in methods[1:]] for budget in (2, 0)]


def imported(out, folder):
    rows = [[], []]
    for scene in IMPORTED:
        picture = out / f"{scene}.exr"
        fanal("render", folder / scene / "scene.xml", "--guide", "gaussian", "--time", "40", "-o", picture, "--quiet")
        rows[0].append(developed(picture))
        rows[1].append(developed(folder / scene / "reference.exr"))
    side_by_side(rows).save(SCENES / "imported.png", optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--imported", type=pathlib.Path)
    parser.add_argument("--time")
    parser.add_argument("--seeds", default="4")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    told = lambda ratios: "{:.2g}, {:.2g} and {:.2g}".format(*ratios)
    late, early = easy(args.out)
    title = f"After {args.time} seconds, 192 × 192 pixels, trimmed relMSE, geometric means over {args.seeds} seeds with 95 % intervals:"
    equal = f"{title}\n\n{table(args.out, args.time, args.seeds)}\n\n" if args.time else ""
    door(args.out)
    text = f"""{equal}On `cornell`, a box under a lamp, which needs no guide, `variance`, `gaussian` and `neural` have {told(late)} times the
trimmed relMSE of `none` after 8 seconds, and {told(early)} times after 2 (2 seeds)."""
    if args.imported:
        imported(args.out, args.imported)
    page = ROOT / "docs/measurements.md"
    begin, end = "<!-- tests/bench/figures.py: begin -->", "<!-- end -->"
    block = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    before = page.read_text()
    if not block.search(before):
        sys.exit(f"{page} has no place for the table: {begin} … {end}")
    page.write_text(block.sub(lambda _: f"{begin}\n{text}\n{end}", before))


if __name__ == "__main__":
    sys.exit(main())

#!/usr/bin/env python3
"""fanal beside Mitsuba 3 on scenes by others, in the same time on the same cores, with paired seeds: tables with intervals, and a plot of where guiding pays.

    pip install mitsuba numpy          (for llvm_ad_rgb LLVM 19, too)
    python3 tests/bench/equal_time.py SCENE_FOLDER... --journal FILE [--fanal FANAL] [--methods none,gaussian,neural] [--time 20 | --spp 64]
        [--seeds 8] [--first-seed 1] [--mitsuba llvm_ad_rgb] [--untrimmed] [--keep FOLDER] [--lock FILE] [--plot FILE.svg]

Each folder holds a scene.xml or scene.json and a reference.exr, and reference_variance.exr if the reference's own noise is known: it is subtracted.
All methods of a seed are rendered before the next seed begins, so that what changes slowly about the machine does so for all. Every render
is a line of the journal as soon as it ends; the same command goes on where it was interrupted. With --lock every render holds that file
(flock), so that other work that does so too can be done in turns. --keep keeps our pictures of the first seed as SCENE-METHOD.exr, of which
sheet.py makes one. With --spp all methods get as many samples instead, learning included; journals of parts of the seeds (--first-seed) or
methods, from whatever machines, may then be put one after the other.

Tables: geometric means over the seeds of ratios of trimmed relMSE, with 95 % intervals of Student's t on their logarithms from three seeds on,
where there are few columns; with --untrimmed of all of it, too. Without Mitsuba the first column is the error of `none` itself.
"""

import argparse
import contextlib
import fcntl
import json
import math
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile

from versions import mitsuba, run

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Quantiles 0.975 of Student's t by degrees of freedom (from 30 on, the normal distribution's is 4 % smaller at most).
STUDENT = [math.nan, 12.71, 4.30, 3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26, 2.23, 2.20, 2.18, 2.16, 2.14, 2.13]
PEER = "mitsuba"


class Journal:
    """What was rendered: errors, CPU seconds and samples by scene, method, budget (seconds, or samples as "64 spp") and seed."""

    def __init__(self, path):
        self.path, self.rows, self.kind = path, {}, "trimmed"
        for line in path.read_text().splitlines() if path.exists() else ():
            row = json.loads(line)
            self.rows[self.key(row)] = row

    @staticmethod
    def key(row):
        return row["scene"], row["method"], row.get("budget", row.get("seconds")), row["seed"]

    def add(self, row):
        self.rows[self.key(row)] = row
        with self.path.open("a") as file:
            file.write(json.dumps(row) + "\n")

    def seconds(self):
        return sorted({key[2] for key in self.rows if not isinstance(key[2], str)})

    def scenes(self):
        return list(dict.fromkeys(key[0] for key in self.rows))

    def errors(self, scene, method, budget):
        """Trimmed relMSE by seed, or all of it where `kind` is "all"."""
        return {key[3]: row[self.kind] for key, row in self.rows.items() if key[:3] == (scene, method, budget)}

    def over(self, scene, method, base, budget):
        """Geometric mean over common seeds of a method's error over another's (itself without one), and the half of its interval as a factor."""
        ours = self.errors(scene, method, budget)
        theirs = self.errors(scene, base, budget) if base else dict.fromkeys(ours, 1.0)
        logs = [math.log(ours[seed] / theirs[seed]) for seed in ours.keys() & theirs.keys()]
        if not logs:
            return None
        # Of two seeds it would be a factor of tens.
        half = statistics.stdev(logs) / math.sqrt(len(logs)) * STUDENT[min(len(logs), len(STUDENT)) - 1] if len(logs) > 2 else math.nan
        return math.exp(statistics.mean(logs)), half


def cell(ratio, interval):
    """A ratio, with its interval if that is wanted and known, as text."""
    if ratio is None:
        return "–"
    mean, half = ratio
    number = lambda value: f"{value:.2f}" if 0.095 <= value < 9.95 else f"{value:.2g}" if value < 1 else f"{value:.0f}"
    return number(mean) if math.isnan(half) or not interval else f"{number(mean)} [{number(mean * math.exp(-half))}, {number(mean * math.exp(half))}]"


def table(journal, columns):
    """Markdown of ratios: a row per scene and the geometric mean of all; columns are (head, method, base, budget), as `over` has them."""
    lines = ["| | " + " | ".join(head for head, *_ in columns) + " |", "|---" * (len(columns) + 1) + "|"]
    found = {scene: [journal.over(scene, *column[1:]) for column in columns] for scene in journal.scenes()}
    lines += [f"| `{scene}` | " + " | ".join(cell(ratio, len(columns) <= 6) for ratio in row) + " |" for scene, row in found.items()]
    means = [[math.log(ratio[0]) for ratio in column if ratio and head[2]] for head, column in zip(columns, zip(*found.values()))]
    lines.append("| geometric mean | " + " | ".join(f"{math.exp(statistics.mean(logs)):.2f}" if logs else "" for logs in means) + " |")
    return "\n".join(lines)


def plot(journal, method, base):
    """SVG of a method's error over another's against seconds, both logarithmic, a line per scene."""
    width, height, left, right, top, bottom = 640, 400, 56, 120, 16, 44
    lines = {scene: [(s, r[0]) for s in journal.seconds() if (r := journal.over(scene, method, base, s))] for scene in journal.scenes()}
    points = [point for line in lines.values() for point in line]
    (first, last), (low, high) = ([f(p[i] for p in points) for f in (min, max)] for i in (0, 1))
    low, high = min(low, 0.5) / 1.1, max(high, 1.5) * 1.1
    x = lambda s: left + (width - left - right) * math.log(s / first) / max(math.log(last / first), 1e-9)
    y = lambda r: top + (height - top - bottom) * math.log(high / r) / math.log(high / low)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="12" fill="#222">',
             f'<rect width="{width}" height="{height}" fill="#fff"/>']
    for r in (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2):
        if low < r < high:
            stroke = 'stroke="#222" stroke-width="1.2"' if r == 1 else 'stroke="#ddd"'
            parts.append(f'<path d="M{left} {y(r):.1f}H{width - right}" {stroke}/><text x="{left - 6}" y="{y(r) + 4:.1f}" text-anchor="end">{r:g}</text>')
    for s in sorted({p[0] for p in points}):
        parts.append(f'<path d="M{x(s):.1f} {top}V{height - bottom}" stroke="#eee"/>'
                     f'<text x="{x(s):.1f}" y="{height - bottom + 18}" text-anchor="middle">{s:g}</text>')
    colors = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#7a5195", "#555555"]
    ends = sorted(((y(line[-1][1]), scene) for scene, line in lines.items() if line))
    place = {}
    for at, scene in ends:
        # Names that would cover one another move down.
        place[scene] = max(at, max(place.values(), default=-math.inf) + 14)
    up = max(0.0, max(place.values(), default=0.0) - (height - bottom))
    for number, (scene, line) in enumerate(lines.items()):
        color = colors[number % len(colors)]
        path = "L".join(f"{x(s):.1f} {y(r):.1f}" for s, r in line)
        parts.append(f'<path d="M{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        parts += [f'<circle cx="{x(s):.1f}" cy="{y(r):.1f}" r="3" fill="{color}"/>' for s, r in line]
        parts.append(f'<text x="{width - right + 8}" y="{place[scene] - up + 4:.1f}" fill="{color}">{scene}</text>')
    parts.append(f'<text x="{(left + width - right) / 2}" y="{height - 8}" text-anchor="middle">seconds on two cores</text>'
                 f'<text transform="translate(14 {(top + height - bottom) / 2}) rotate(-90)" text-anchor="middle">error of {method} over {base}</text></svg>')
    return "\n".join(parts) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    parser.add_argument("--journal", type=pathlib.Path, required=True)
    parser.add_argument("--fanal", default=str(ROOT / "target/release/fanal"))
    parser.add_argument("--methods", default="none,gaussian,neural")
    parser.add_argument("--time", default="20")
    parser.add_argument("--spp", type=int)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--mitsuba", metavar="VARIANT")
    parser.add_argument("--untrimmed", action="store_true")
    parser.add_argument("--keep", type=pathlib.Path)
    parser.add_argument("--lock", type=pathlib.Path)
    parser.add_argument("--plot", type=pathlib.Path)
    args = parser.parse_args()
    if args.spp and args.mitsuba:
        parser.error("Mitsuba has a time, not samples: per_sample.py")
    journal, methods = Journal(args.journal), args.methods.split(",")
    budgets = [f"{args.spp} spp"] if args.spp else [float(seconds) for seconds in args.time.split(",")]

    @contextlib.contextmanager
    def alone():
        with args.lock.open("w") if args.lock else contextlib.nullcontext() as file:
            if file:
                fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def render(scene, method, budget, seed):
        with tempfile.TemporaryDirectory() as folder, alone():
            folder = pathlib.Path(folder)
            if method == PEER:
                error, spp = mitsuba(args.mitsuba, args.fanal, scene, budget, seed, folder)
                return {**error, "spp": spp}
            row = run(args.fanal, scene, method, ["--spp", args.spp] if args.spp else ["--time", budget], seed, folder)
            if args.keep and seed == args.first_seed:
                args.keep.mkdir(parents=True, exist_ok=True)
                shutil.move(folder / "out.exr", args.keep / f"{scene.name}-{method}.exr")
            return row

    for seed in range(args.first_seed, args.seeds + 1):
        for scene in args.scenes:
            for budget in budgets:
                for method in [PEER] * bool(args.mitsuba) + methods:
                    row = {"scene": scene.name, "method": method, "budget": budget, "seed": seed}
                    if Journal.key(row) not in journal.rows:
                        journal.add({**row, **render(scene, method, budget, seed)})
    for budget in budgets:
        named = budget if args.spp else f"{budget:g} s"
        columns = [(f"`{method}` over Mitsuba, {named}", method, PEER, budget) for method in methods * bool(args.mitsuba)]
        columns = columns or [(f"`none`, {named}", "none", None, budget)]
        columns += [(f"`{method}` over `none`", method, "none", budget) for method in methods if method != "none"]
        for journal.kind in ["trimmed", "all"][: 1 + args.untrimmed]:
            print(f"{journal.kind}:\n\n{table(journal, columns)}\n", flush=True)
        journal.kind = "trimmed"
    if args.plot:
        args.plot.write_text(plot(journal, methods[-1], "none"))


if __name__ == "__main__":
    sys.exit(main())

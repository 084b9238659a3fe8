#!/usr/bin/env python3
"""What --fireflies reweight is worth: errors of the same samples with and without, what is missing of the light, and what it costs.

    cargo build --release
    tests/bench/fireflies.py target/release/fanal torus/scene.xml=torus/reference.exr ... [--spp 32,128] [--kappa 1,4,16] [--seeds 4]

For each scene and number of samples: relMSE without the worst 0.1 % of pixels and (of all) as rendered, then for each kappa over it, with the part
of the picture's light that is taken out; geometric means over seeds; and the processor seconds of a render with over those of one without.
--options "--guide neural" renders with a guide instead of without.
"""
import argparse
import json
import math
import resource
import subprocess
import tempfile
from pathlib import Path


def processor_seconds():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def geometric(values):
    return math.exp(sum(math.log(value) for value in values) / len(values))


def measured(fanal, scene, reference, options, folder):
    """Errors of a picture, its mean, and what it cost."""
    picture = Path(folder) / "picture.exr"
    begun = processor_seconds()
    subprocess.run([fanal, "render", scene, *options, "--quiet", "-o", picture], check=True)
    seconds = processor_seconds() - begun
    told = subprocess.run([fanal, "error", picture, reference, "--json"], check=True, stdout=subprocess.PIPE)
    return {**json.loads(told.stdout), "seconds": seconds}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fanal")
    parser.add_argument("scenes", nargs="+", metavar="SCENE=REFERENCE")
    parser.add_argument("--spp", default="32,128")
    parser.add_argument("--kappa", default="1,4,16")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--options", default="--guide none", help="of every render")
    args = parser.parse_args()
    kappas = args.kappa.split(",")
    print("| | samples | error | " + " | ".join(f"κ = {kappa}" for kappa in kappas) + " | cost |")
    print("|---|---|---|" + "---|" * len(kappas) + "---|")
    for given in args.scenes:
        scene, reference = given.split("=")
        for spp in args.spp.split(","):
            plain, others = [], {kappa: [] for kappa in kappas}
            with tempfile.TemporaryDirectory() as folder:
                for seed in range(args.seeds):
                    options = [*args.options.split(), "--spp", spp, "--seed", str(seed)]
                    plain.append(measured(args.fanal, scene, reference, options, folder))
                    for kappa in kappas:
                        more = [*options, "--fireflies", "reweight", "--kappa", kappa]
                        others[kappa].append(measured(args.fanal, scene, reference, more, folder))
            error = {name: geometric([one[name] for one in plain]) for name in ("relmse", "relmse_trimmed")}
            cells = []
            for with_kappa in others.values():
                pairs = list(zip(with_kappa, plain))
                over = {name: geometric([new[name] / old[name] for new, old in pairs]) for name in error}
                lost = 1.0 - geometric([new["mean_ratio"] / old["mean_ratio"] for new, old in pairs])
                cells.append(f"{over['relmse_trimmed']:.2f} ({over['relmse']:.2f}) {100 * lost:.1f} %")
            cost = sum(one["seconds"] for one in others[kappas[0]]) / sum(one["seconds"] for one in plain)
            name = Path(scene).parent.name if Path(scene).is_file() else Path(scene).name
            whole = f"{error['relmse_trimmed']:.3g} ({error['relmse']:.3g})"
            print(f"| `{name}` | {spp} | {whole} | " + " | ".join(cells) + f" | {cost:.2f} |", flush=True)


if __name__ == "__main__":
    main()

"""Cycles and fanal side by side: python compare.py FANAL OUT [SCENE...]. Exits with 1 where they differ by more than is explained."""

import os
import subprocess
import sys
import time

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.dirname(HERE)]

import bpy  # noqa: E402

import scenes  # noqa: E402
from fanal_blender import export as exporting  # noqa: E402

# Samples per pixel of each of two renders.
CYCLES = {"room": 64, "outdoors": 48, "product": 128}
FANAL = {"room": 96, "outdoors": 64, "product": 128}
# Largest difference of means, and of a block's beyond four standard deviations, relative.
MEAN, BLOCK = 0.02, 0.05
BLOCKS = (4, 4)


def read(path):
    """Linear pixels of an EXR file, rows from the top."""
    image = bpy.data.images.load(path, check_existing=False)
    values = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(values)
    out = values.reshape(image.size[1], image.size[0], image.channels)[::-1, :, :3].astype(np.float64)
    bpy.data.images.remove(image)
    return out


def cycles(scene, path, seed):
    scene.cycles.seed = seed
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    return read(path)


def fanal(program, scene, path, seed, spp, guide="none"):
    command = [program, "render", scene, "-o", path, "--guide", guide, "--spp", str(spp), "--seed", str(seed), "--quiet",
               "--threads", "2"]
    subprocess.run(command, check=True)
    return read(path)


def blocks(picture):
    """Means of the blocks, per channel."""
    rows, columns = BLOCKS
    height, width, _ = picture.shape
    return picture.reshape(rows, height // rows, columns, width // columns, 3).mean(axis=(1, 3))


def side_by_side(path, pictures):
    """A PNG of pictures beside one another, in sRGB."""
    whole = np.concatenate(pictures, axis=1)
    whole = np.where(whole <= 0.0031308, 12.92 * whole, 1.055 * np.maximum(whole, 0.0031308) ** (1 / 2.4) - 0.055)
    height, width, _ = whole.shape
    image = bpy.data.images.new("side by side", width, height)
    rgba = np.concatenate([np.clip(whole, 0, 1)[::-1], np.ones((height, width, 1))], axis=2).astype(np.float32)
    image.pixels.foreach_set(rgba.ravel())
    image.filepath_raw, image.file_format = path, "PNG"
    image.save()


def compare(program, out, name):
    """Whether the two renderers agree on a scene."""
    folder = os.path.join(out, name)
    os.makedirs(folder, exist_ok=True)
    scene = scenes.ALL[name](CYCLES[name])
    report = exporting.export_scene(folder)
    for warning in report.warnings:
        print(f"  {warning}")
    begun = time.time()
    theirs = [cycles(scene, os.path.join(folder, f"cycles-{seed}.exr"), seed) for seed in (1, 2)]
    between = time.time()
    ours = [fanal(program, report.scene, os.path.join(folder, f"fanal-{seed}.exr"), seed, FANAL[name]) for seed in (1, 2)]
    print(f"{name}: Cycles {between - begun:.1f} s, fanal {time.time() - between:.1f} s")
    side_by_side(os.path.join(folder, "side-by-side.png"), [sum(theirs) / 2, sum(ours) / 2])
    # Half the difference of two independent renders is the error of their mean.
    means = [sum(blocks(picture) for picture in pair) / 2 for pair in (theirs, ours)]
    noise = np.sqrt(sum(((blocks(pair[0]) - blocks(pair[1])) / 2) ** 2 for pair in (theirs, ours)))
    # One pair says little of one block's noise: the middle one of all blocks, relative, is the least.
    noise = np.maximum(noise, np.median(noise / means[0]) * means[0])
    whole = [mean.mean(axis=(0, 1)) for mean in means]
    difference = whole[1] / whole[0] - 1.0
    print(f"{name}: means {np.round(whole[0], 5)} (Cycles) {np.round(whole[1], 5)} (fanal): {np.round(100 * difference, 2)} %")
    relative = means[1] / means[0] - 1.0
    print(np.round(100 * relative.mean(axis=2), 1))
    excess = np.abs(relative) - 4.0 * noise / means[0]
    print(f"{name}: worst block {100 * np.abs(relative).max():.1f} %, of which {100 * max(excess.max(), 0.0):.1f} % are not noise")
    return bool(np.abs(difference).max() <= MEAN and excess.max() <= BLOCK)


if __name__ == "__main__":
    program, out, *names = sys.argv[1:]
    failed = [name for name in names or scenes.ALL if not compare(program, os.path.abspath(out), name)]
    if failed:
        sys.exit(f"differences beyond what is explained: {', '.join(failed)}")

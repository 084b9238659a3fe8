"""What a job asks of Slurm: memory and time, from a probe of the scene and from constants that docs/cluster.md says how to measure."""

import json
import math
import re
import subprocess
import tempfile
from pathlib import Path

MB = 1e6

# Samples per pixel in a block, which is the least that a part renders: `BLOCK` of the program.
SAMPLES_PER_BLOCK = 64
# What a part keeps of each of its blocks until it is written (13 where no variances are wanted), and a checkpoint while it is written.
BLOCK_BYTES_PER_PIXEL = 38
CHECKPOINT_BYTES_PER_PIXEL = 100
# Merging: what the program itself takes, and what a pixel does (the sum of a band, the picture), without and with layers.
MERGE_BASE = 64 * MB
MERGE_BYTES_PER_PIXEL = 50
MERGE_BYTES_PER_PIXEL_AND_LAYERS = 100
# What a pixel takes besides where fireflies are taken out: samples by brightness, of the whole picture and of the part that is being read.
MERGE_BYTES_PER_PIXEL_BY_BRIGHTNESS = 500
# Seconds that a block of samples takes to be read and added, for a pixel, without and with variances.
MERGE_SECONDS_PER_PIXEL = 2e-8
MERGE_SECONDS_PER_PIXEL_AND_LAYERS = 6e-8
# Parts that are merged at a time while others are rendered: in a frame of thousands no merge at the end is in the way.
MERGED = 500
# A thread's buffers of paths and records.
BYTES_PER_THREAD = 8 * MB
# A guide in memory, over the size of its file; the ceiling of learning (--guide-memory, in bytes) where there is no file yet.
GUIDE_BYTES_PER_FILE_BYTE = 4
GUIDE_CEILING = 24 * MB
# Learning: what paths leave at their vertices (2^18 of them are traced at a time, however many pixels there are), and what is learned, over the
# ceiling of the guide that it becomes.
RECORDS = 600 * MB
LEARNER_BYTES_PER_GUIDE_BYTE = 60
# Merging guides: seconds that a part takes to be read and added, over its ceiling in bytes, and of making the guide.
GUIDE_MERGE_SECONDS_PER_BYTE = 1e-7
GUIDE_SECONDS = 300.0
# Seconds of a guided sample over those of a plain one, where a guide is worth most.
GUIDED = 3.5
# Making data: the program and its records, and what is learned in voxels on surfaces, of which there are as the square of the grid's cells.
DATASET_BASE = 400 * MB
DATASET_BYTES_PER_CELL_SQUARED = 330e3
# The recipe's grids where it names none.
DATASET_GRID = 16
# Training: the program, network and steps; the data in memory over the size of their files.
TRAIN_BASE = 500 * MB
TRAIN_BYTES_PER_FILE_BYTE = 3
# What is asked for, over what is expected. A part that needs longer is requeued and goes on, so that a wrong guess of time costs minutes; a part
# that needs more memory is killed, and would be again.
SPARE_MEMORY = 1.5
SPARE_TIME = 2.0
# Seconds from a job's start to the program's, and the warning before the time limit with Slurm's resolution of it.
START = 60.0
WARNING = 180.0
# Options of `fanal render` that say how a guide is learned: where one is loaded they are refused, or do nothing.
LEARNING = {"--model", "--backend", "--samples", "--target", "--direct", "--fraction", "--filter", "--simple-iterations", "--past", "--reconstruct"}
# What a render without a guide refuses besides; and what is for checkpoints, which the probe does not write.
GUIDED_ONLY = LEARNING | {"--guided-distances"}
CHECKPOINTS = {"--every"}


class Probe:
    """What one sample per pixel has shown of a scene."""

    def __init__(self, width, height, peak_bytes, threads, load, build, write, samples_per_second):
        self.width = width
        self.height = height
        self.pixels = width * height
        self.peak_bytes = peak_bytes
        self.threads = threads
        self.once = load + build + write
        self.rate = samples_per_second / threads


def option(word):
    """The option that a word of a command line names, in its long form; none where it is a value."""
    # Numbers and effects may begin with a hyphen; -D is the short form of --define.
    if not re.match("--[A-Za-z]|-D", word):
        return None
    return "--define" if word.startswith("-D") else word.split("=")[0]


def chosen(options, wanted):
    """Those of the options of which `wanted` is true, with their values. What stands before all options has no name."""
    kept, keep = [], wanted(None)
    for word in options:
        name = option(word)
        keep = keep if name is None else wanted(name)
        if keep:
            kept.append(word)
    return kept


def without(options, names):
    """The options but for those with these names and their values."""
    return chosen(options, lambda name: name not in names)


def probe(fanal, scene, options, threads, guided):
    """Renders one sample per pixel, without a guide; options that only a `guided` render has are left out there.

    Raises subprocess.CalledProcessError where the program refuses the scene or the options.
    """
    options = without(options, CHECKPOINTS | GUIDED_ONLY if guided else CHECKPOINTS)
    with tempfile.TemporaryDirectory() as folder:
        stats = Path(folder) / "stats.json"
        command = [fanal, "render", scene, *options, "--guide", "none", "--spp", "1", "--threads", threads, "--quiet"]
        command += ["-o", Path(folder) / "probe.exr", "--stats", stats]
        subprocess.run([str(word) for word in command], check=True)
        found = json.loads(stats.read_text())
    seconds = found["seconds"]
    rate = found["samples"] / max(seconds["trace"], 1e-3)
    return Probe(found["width"], found["height"], found["peak_rss_bytes"], threads, seconds["load"], seconds["build"], seconds["write"], rate)


def blocks(spp):
    """Blocks of so many samples per pixel."""
    return math.ceil(spp / SAMPLES_PER_BLOCK)


def division(spp, parts):
    """How a picture is divided into about so many parts: windows, and parts of each, which are no more than its blocks."""
    windows = math.ceil(parts / blocks(spp))
    return windows, math.ceil(parts / windows)


def guide_bytes(file, ceiling):
    """Memory of a guide: of a file, or of one of `ceiling` bytes where there is none yet."""
    return GUIDE_BYTES_PER_FILE_BYTE * (file.stat().st_size if file else ceiling)


def learner_bytes(ceiling):
    """Memory of learning a guide of at most `ceiling` bytes, beside what rendering takes."""
    return RECORDS + LEARNER_BYTES_PER_GUIDE_BYTE * ceiling


def render_memory(probed, threads, guide, own_blocks=0):
    """Bytes of a task that renders or learns: what the probe took, threads that it did not have, the guide or the learner, blocks of a part, a
    checkpoint."""
    more = max(threads - probed.threads, 0) * BYTES_PER_THREAD
    pixel = CHECKPOINT_BYTES_PER_PIXEL + own_blocks * BLOCK_BYTES_PER_PIXEL
    return SPARE_MEMORY * (probed.peak_bytes + more + guide + pixel * probed.pixels)


def render_seconds(probed, spp, threads, guided):
    """Seconds of a task that renders or learns by `spp` samples per pixel."""
    tracing = probed.pixels * spp / (probed.rate * threads) * (GUIDED if guided else 1)
    return START + WARNING + SPARE_TIME * (probed.once + tracing)


def merge_memory(pixels, layers=False, by_brightness=False):
    """Bytes of merging: parts are read one by one, so that their number does not matter. `by_brightness`: fireflies are taken out."""
    pixel = MERGE_BYTES_PER_PIXEL_AND_LAYERS if layers else MERGE_BYTES_PER_PIXEL
    pixel += MERGE_BYTES_PER_PIXEL_BY_BRIGHTNESS if by_brightness else 0
    return SPARE_MEMORY * (MERGE_BASE + pixel * pixels)


def merge_seconds(pixels, blocks, layers=False):
    """Seconds of merging so many blocks of the whole picture, in however many parts. A merge does not go on where it was ended."""
    pixel = MERGE_SECONDS_PER_PIXEL_AND_LAYERS if layers else MERGE_SECONDS_PER_PIXEL
    return START + WARNING + SPARE_TIME * blocks * pixels * pixel


def guide_merge_memory(ceiling):
    """Bytes of merging guides: what all parts have counted so far, and the part that is being read, with its file."""
    return SPARE_MEMORY * (MERGE_BASE + 2 * LEARNER_BYTES_PER_GUIDE_BYTE * ceiling)


def guide_merge_seconds(ceiling, parts):
    """Seconds of merging guides."""
    return START + WARNING + SPARE_TIME * (GUIDE_SECONDS + parts * ceiling * GUIDE_MERGE_SECONDS_PER_BYTE)


def dataset_memory(recipe):
    """Bytes of making the scenes of a recipe, of which this is the text, one at a time."""
    found = re.search(r"^\s*grids\s*=\s*\[([^]]*)\]", recipe, re.MULTILINE)
    cells = [int(word) for word in re.findall(r"\d+", found.group(1))] if found else []
    return SPARE_MEMORY * (DATASET_BASE + DATASET_BYTES_PER_CELL_SQUARED * max(cells, default=DATASET_GRID) ** 2)


def train_memory(data):
    """Bytes of training or of an evaluation, which hold all data."""
    size = sum(file.stat().st_size for file in data.glob("*.safetensors"))
    return SPARE_MEMORY * (TRAIN_BASE + TRAIN_BYTES_PER_FILE_BYTE * size)


def megabytes(size):
    """Memory as Slurm's --mem has it, where M is 2^20 bytes; no less than 256."""
    return f"{max(math.ceil(size / 2**20), 256)}M"


def limit(seconds):
    """Time as Slurm's --time has it; no less than ten minutes."""
    minutes = max(math.ceil(seconds / 60), 10)
    return f"{minutes // 60}:{minutes % 60:02}:00"

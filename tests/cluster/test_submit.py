"""What integrations/cluster/submit asks Slurm for, with a program that only answers the probe."""

import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
import unittest

CLUSTER = pathlib.Path(__file__).resolve().parents[2] / "integrations/cluster"
sys.path.insert(0, str(CLUSTER))

import resources  # noqa: E402 (the folder has to be on the path before)
from jobs import Job  # noqa: E402

# 1000 x 500 pixels at 50,000 samples per second and thread, in 100 MB. Command lines of probes are kept beside it.
PROGRAM = """#!/usr/bin/env python3
import json, sys
if "--help" in sys.argv:
    print("--size --seed --crop --guide-memory -D, --define --model --past --filter --guided-distances --effects --every")
else:
    print(json.dumps(sys.argv[1:]), file=open(sys.argv[0] + ".probes", "a"))
    seconds = {"load": 1.0, "build": 2.0, "write": 3.0, "trace": 10.0}
    side = 10 if "--crop" in sys.argv else 1
    stats = {"width": 1000 // side, "height": 500 // side, "samples": 500000, "peak_rss_bytes": 100000000, "seconds": seconds}
    open(sys.argv[sys.argv.index("--stats") + 1], "w").write(json.dumps(stats))
"""


class Submitted(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.recipe = self.folder / "recipe.toml"
        self.recipe.write_text('name = "a recipe"\ngrids = [8, 11]\n')
        self.addCleanup(lambda: subprocess.run(["rm", "-rf", str(self.folder)], check=True))
        self.program = self.folder / "fanal"
        self.program.write_text(PROGRAM)
        self.program.chmod(0o755)
        # In place of the script that runs the program.
        (self.folder / "requeue").symlink_to("/bin/echo")

    def submit(self, *words):
        command = [sys.executable, CLUSTER / "submit", words[0], "--dry-run", *words[1:]]
        environment = {**os.environ, "FANAL": str(self.program), "FANAL_TRAINING": str(self.program)}
        answer = subprocess.run([str(word) for word in command], env=environment, check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        calls = [shlex.split(line.split("=$(")[1][:-1]) for line in answer.stdout.splitlines() if "=$(" in line]
        return calls, answer.stderr

    def probes(self):
        """Options of the probes so far, after the scene."""
        return [json.loads(line)[2:] for line in (self.folder / "fanal.probes").read_text().splitlines()]

    def scripts(self, calls):
        return [next(pathlib.Path(word).name for word in call if word.endswith(".sbatch")) for call in calls]

    def test_learns_renders_and_merges(self):
        calls, _ = self.submit("room", "--spp", 4096, "--parts", 64, "--guide", "neural", "-o", "out.exr", "--", "--size", "10x10", "--aov", "all")
        self.assertEqual(self.scripts(calls), ["learn.sbatch", "render.sbatch", "merge.sbatch"])
        learn, render, merge = calls
        self.assertFalse(any(word.startswith("--dependency") for word in learn))
        self.assertIn("--dependency=afterok:$fanal_learn", render)
        self.assertIn("--dependency=afterok:$fanal_render", merge)
        self.assertIn("--array=1-64", render)
        self.assertEqual(learn[-2:], ["--size", "10x10"])
        self.assertEqual(render[-4:], ["--size", "10x10", "--aov", "all"])
        self.assertIn(str(pathlib.Path("out.exr.parts/1.guide").resolve()), render)

    def test_several_learn(self):
        calls, _ = self.submit("room", "--spp", 4096, "--parts", 2, "--learn-parts", 4, "-o", "out.exr")
        self.assertEqual(self.scripts(calls), ["learn.sbatch", "merge.sbatch", "render.sbatch", "merge.sbatch"])
        self.assertIn("--dependency=afterok:$fanal_guide", calls[2])
        self.assertEqual(calls[1][-2:], ["guide", "1-4"])
        # A guide's parts have what learning has, not what a picture has.
        self.assertGreater(self.asked(calls[1]), resources.LEARNER_BYTES_PER_GUIDE_BYTE * resources.GUIDE_CEILING)
        smaller, _ = self.submit("room", "--spp", 4096, "--parts", 2, "--learn-parts", 4, "-o", "out.exr", "--", "--guide-memory", "6")
        for big, small in zip(calls, smaller):
            self.assertGreaterEqual(self.asked(big), self.asked(small))
        saved = resources.SPARE_MEMORY * resources.LEARNER_BYTES_PER_GUIDE_BYTE * 18e6
        self.assertAlmostEqual(self.asked(calls[0]) - self.asked(smaller[0]), saved, delta=2**21)

    def asked(self, call):
        """Bytes that a call asks for."""
        return 2**20 * int(next(word for word in call if word.startswith("--mem="))[6:-1])

    def test_guides_are_learned_from_the_whole_picture(self):
        for learners in (1, 3):
            calls, _ = self.submit("room", "--spp", 64, "--parts", 1, "--learn-parts", learners, "-o", "out.exr", "--", "--crop", "0,0,10,10", "--seed", 3)
            for call in calls:
                name = self.scripts([call])[0]
                self.assertEqual("--crop" in call, name == "render.sbatch", call)
                self.assertEqual("--seed" in call, name != "merge.sbatch" or "guide" in call, call)
            whole, _ = self.submit("room", "--spp", 64, "--parts", 1, "--learn-parts", learners, "-o", "out.exr")
            self.assertEqual(self.asked(calls[0]), self.asked(whole[0]))
            self.assertLess(self.asked(calls[-2]), self.asked(whole[-2]))

    def test_learning_knows_what_the_scene_asks_for(self):
        options = ["-D", "depth=8", "--aov", "all", "-Dwidth=10", "-D", "shift=-1", "--effects", "-photons", "--seed", 3]
        calls, _ = self.submit("room", "--spp", 64, "--parts", 1, "-o", "out.exr", "--", *options)
        learn, render, _ = calls
        self.assertEqual(learn[-9:], ["-D", "depth=8", "-Dwidth=10", "-D", "shift=-1", "--effects", "-photons", "--seed", "3"])
        self.assertEqual(render[-11:], [str(word) for word in options])

    def test_options_of_learning_are_for_learning_alone(self):
        options = ["--model=models/mine", "--size", "10x10", "--past", "0.25", "--filter", "--guided-distances", "on", "--every", "1"]
        common = ["room", "--spp", 64, "--parts", 1, "-o", "out.exr"]
        calls, _ = self.submit(*common, "--", *options)
        learn, render, _ = calls
        self.assertEqual(learn[-10:], options)
        self.assertEqual(render[-8:], ["--spp", "64", "--size", "10x10", "--guided-distances", "on", "--every", "1"])
        self.assertEqual(self.probes()[-1][:4], ["--size", "10x10", "--guide", "none"])
        self.submit(*common, "--", "--crop", "0,0,10,10", *options)
        self.assertEqual([probe[:4] for probe in self.probes()[-2:]], [["--crop", "0,0,10,10", "--size", "10x10"], ["--size", "10x10", "--guide", "none"]])
        # Without a guide the program refuses them, and nothing is sent.
        self.submit(*common, "--guide", "none", "--", *options)
        self.assertEqual(self.probes()[-1][:8], options[:8])
        guide = self.folder / "some.guide"
        guide.write_bytes(b"guide")
        for learns in (["--past", "0.25"], ["--past=0.25"], ["--size", "8x8", "--filter"]):
            with self.assertRaises(subprocess.CalledProcessError):
                self.submit(*common, "--load-guide", guide, "--", *learns)
        self.submit(*common, "--load-guide", guide, "--", "--guided-distances", "on")

    def test_options_of_learning_are_those_that_a_loaded_guide_refuses(self):
        source = (CLUSTER.parents[1] / "src/cli/args.rs").read_text()
        refused = re.search(r"conflicts_with_all = \[([^]]*)\]\)\]\s+pub load_guide:", source).group(1)
        names = {"--" + name.replace("_", "-") for name in re.findall(r'"(\w+)"', refused)}
        # It is not refused, but does nothing.
        self.assertEqual(resources.LEARNING, names | {"--backend"})

    def test_the_template_divides_options_likewise(self):
        """What the template runs for a part, with `echo` in place of the program."""
        found = re.search(r"- name: Render\n +type: TEXT\n +data: \|\n((?: {12}.*\n)+)", (CLUSTER / "openjd.yaml").read_text())
        learning = [word for name in sorted(resources.LEARNING) for word in ([name, "1"], [f"{name}=1"])]
        others = ["--size", "8x8", "-D", "shift=-1", "--effects", "-photons"]
        options = others[:2] + [word for words in learning for word in words] + others[2:]
        for guide, expected in (("gaussian", others), ("none", options)):
            values = {"Guide": guide, "Options": " ".join(options), "Fanal": "echo", "Scene": "room", "Output": "out", "Spp": "64", "Part": "1", "Parts": "2"}
            script = re.sub(r"{{(?:Task\.)?Param\.(\w+)}}", lambda name: values[name.group(1)], textwrap.dedent(found.group(1)))
            words = subprocess.run(["bash", "-c", script], check=True, stdout=subprocess.PIPE, text=True).stdout.split()
            self.assertEqual(words[words.index("--spp") + 2 : words.index("--part")], expected)
            self.assertEqual("--load-guide" in words, guide != "none")

    def test_merges_have_memory_for_samples_by_brightness(self):
        merges = []
        for options in ([], ["--fireflies", "keep"], ["--fireflies", "reweight"], ["--fireflies=reweight"]):
            calls, _ = self.submit("room", "--spp", 4096, "--parts", 2, "--guide", "none", "-o", "out.exr", "--", *options)
            merges.append(self.asked(calls[-1]))
        self.assertTrue(merges[0] == merges[1] < merges[2] == merges[3], merges)
        self.assertAlmostEqual(merges[2], resources.merge_memory(500000, by_brightness=True), delta=2**20)

    def test_parts_have_the_mode_of_their_guide(self):
        calls, _ = self.submit("room", "--spp", 64, "--parts", 1, "--guide", "ppg", "-o", "out.exr")
        render = calls[1]
        self.assertEqual(render[render.index("--guide") + 1], "ppg")
        self.assertIn("--load-guide", render)
        self.assertIn("ppg", calls[0])

    def test_nothing_is_learned(self):
        guide = self.folder / "some.guide"
        guide.write_bytes(b"guide")
        for how in (["--guide", "none"], ["--load-guide", guide]):
            calls, _ = self.submit("room", "--spp", 4096, "--parts", 2, *how, "-o", "out.exr")
            self.assertEqual(self.scripts(calls), ["render.sbatch", "merge.sbatch"])
            self.assertTrue(set(map(str, how[1:])) <= set(calls[0]))

    def test_more_parts_than_blocks_are_windows(self):
        calls, _ = self.submit("room", "--spp", 1024, "--parts", 64, "--guide", "none", "-o", "out.exr")
        self.assertIn("--array=1-64", calls[0])
        begin = calls[0].index(next(word for word in calls[0] if word.endswith("render.sbatch")))
        self.assertEqual(calls[0][begin + 1 : begin + 4], ["16", "4", "1000x500"])
        self.assertEqual(calls[1][-2:], ["part", "1-64"])
        with self.assertRaises(subprocess.CalledProcessError):
            self.submit("room", "--spp", 1024, "--parts", 64, "--guide", "none", "-o", "out.exr", "--", "--crop", "0,0,10,10")

    def test_windows_are_all_rows_once(self):
        """What render.sbatch makes of its task, with `echo` in place of the program."""
        runs = []
        for task in range(1, 13):
            environment = {**os.environ, "FANAL_CLUSTER": str(self.folder), "FANAL": "fanal", "SLURM_ARRAY_TASK_ID": str(task)}
            command = ["bash", str(CLUSTER / "render.sbatch"), "4", "3", "640x100", "parts", "room"]
            runs.append(subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout.split())
        options = [{name: words[words.index(name) + 1] for name in ("--crop", "--part", "-o")} for words in runs]
        self.assertEqual([option["-o"] for option in options], [f"parts/{task}.part" for task in range(1, 13)])
        self.assertEqual([option["--part"] for option in options], ["1/4", "2/4", "3/4", "4/4"] * 3)
        self.assertEqual([option["--crop"] for option in options[::4]], ["0,0,640,33", "0,33,640,33", "0,66,640,34"])

    def test_merges_while_others_are_rendered(self):
        calls, _ = self.submit("room", "--spp", 200000, "--parts", 1200, "--guide", "none", "-o", "out.exr")
        self.assertEqual(self.scripts(calls), ["render.sbatch", "merge.sbatch"] * 3)
        self.assertEqual([word for call in calls for word in call if word.startswith("--array")], ["--array=1-500", "--array=1-500", "--array=1-200"])
        parts = pathlib.Path("out.exr.parts").resolve()
        self.assertEqual([call[-4:] for call in calls[1::2]], [
            [str(parts / "500.sum"), str(parts), "part", "1-500"],
            [str(parts / "1000.sum"), str(parts), "part", "501-1000"],
            [str(parts.parent / "out.exr"), str(parts), "part", "1001-1200"],
        ])
        self.assertIn("--dependency=afterok:$fanal_render", calls[1])
        self.assertIn("--dependency=afterok:$fanal_render500:$fanal_sum", calls[3])
        self.assertIn("--dependency=afterok:$fanal_render1000:$fanal_sum500", calls[5])

    def test_sums_are_merged_with_the_parts_after_them(self):
        """What merge.sbatch runs, with `echo` in place of the program."""
        def merge(*words):
            command = ["bash", str(CLUSTER / "merge.sbatch"), *words]
            return subprocess.run(command, env={**os.environ, "FANAL": "echo"}, check=True, stdout=subprocess.PIPE, text=True).stdout.split()

        self.assertEqual(merge("2.sum", "a", "part", "1-2"), ["merge", "a/1.part", "a/2.part", "-o", "2.sum"])
        self.assertEqual(merge("o.exr", "a", "part", "3-4", "--quiet"), ["merge", "a/2.sum", "a/3.part", "a/4.part", "-o", "o.exr", "--quiet"])

    def test_more_parts_than_an_array_takes(self):
        calls, _ = self.submit("room", "--spp", 200000, "--parts", 2500, "--merged", 2500, "--guide", "none", "-o", "out.exr")
        self.assertEqual([word for call in calls for word in call if word.startswith("--array")], ["--array=1-1000", "--array=1-1000", "--array=1-500"])
        self.assertEqual([call[0] for call in calls[:3]], ["sbatch", "FANAL_TASKS_BEFORE=1000", "FANAL_TASKS_BEFORE=2000"])
        self.assertIn("--dependency=afterok:$fanal_render:$fanal_render1000:$fanal_render2000", calls[3])

    def test_names_with_spaces(self):
        calls, _ = self.submit("a room", "--spp", 64, "--parts", 1, "--guide", "none", "-o", "an output/out.exr")
        self.assertIn(str(pathlib.Path("a room").resolve()), calls[0])
        self.assertIn(str(pathlib.Path("an output/out.exr").resolve()), calls[1])

    def test_data_set_and_sweep(self):
        calls, _ = self.submit("dataset", self.recipe, "--parts", 16, "-o", "data")
        self.assertEqual(self.scripts(calls), ["dataset.sbatch", "merge.sbatch"])
        self.assertIn("--array=1-16", calls[0])
        calls, _ = self.submit("train", self.folder, "--seeds", "1,2,3", "--widths", "16,32", "-o", "models", "--", "--epochs", 3)
        self.assertEqual(self.scripts(calls), ["train.sbatch", "pick.sbatch"])
        self.assertIn("--array=1-6", calls[0])
        self.assertEqual(calls[0][-6:], ["1 2 3", "16 32", "--minutes", "30", "--epochs", "3"])

    def test_what_is_asked_for_wins(self):
        calls, _ = self.submit("room", "--spp", 64, "--parts", 1, "--guide", "none", "--mem", 5000, "--time", "2:00:00", "--cpus", 8, "--sbatch=--partition=long", "-o", "out.exr")
        self.assertTrue({"--mem=5000M", "--time=2:00:00", "--cpus-per-task=8", "--partition=long"} <= set(calls[0]))
        wanted = ["--mem", 5000, "--time", "2:00:00"]
        for words in (["room", "--spp", 4096, "--parts", 600, "--learn-parts", 2], ["dataset", self.recipe, "--parts", 2]):
            calls, _ = self.submit(*words, *wanted, "-o", "out")
            self.assertTrue(all({"--mem=5000M", "--time=2:00:00"} <= set(call) for call in calls), calls)


class Formulas(unittest.TestCase):
    def setUp(self):
        self.probe = resources.Probe(1000, 500, 100e6, 2, 1.0, 2.0, 3.0, 100e3)

    def test_time(self):
        # 64 samples for each of 500,000 pixels at 50,000 a second and thread, on 4 threads; 6 s besides.
        expected = resources.START + resources.WARNING + resources.SPARE_TIME * (6 + 160)
        self.assertAlmostEqual(resources.render_seconds(self.probe, 64, 4, False), expected)
        self.assertAlmostEqual(resources.render_seconds(self.probe, 64, 4, True), expected + resources.SPARE_TIME * 160 * (resources.GUIDED - 1))

    def test_memory(self):
        plain = resources.render_memory(self.probe, 2, 0)
        self.assertAlmostEqual(plain, resources.SPARE_MEMORY * (100e6 + resources.CHECKPOINT_BYTES_PER_PIXEL * 500000))
        blocks = resources.render_memory(self.probe, 2, 0, 3) - plain
        self.assertAlmostEqual(blocks, resources.SPARE_MEMORY * 3 * resources.BLOCK_BYTES_PER_PIXEL * 500000)
        threads = resources.render_memory(self.probe, 10, 0) - plain
        self.assertAlmostEqual(threads, resources.SPARE_MEMORY * 8 * resources.BYTES_PER_THREAD)

    def test_merging(self):
        plain = resources.merge_memory(10**6)
        self.assertAlmostEqual(plain - resources.merge_memory(0), resources.SPARE_MEMORY * resources.MERGE_BYTES_PER_PIXEL * 1e6)
        self.assertGreater(resources.merge_memory(10**7, layers=True), 1.5 * resources.merge_memory(10**7))
        for layers in (False, True):
            besides = resources.merge_memory(10**6, layers, True) - resources.merge_memory(10**6, layers)
            # What samples by brightness take at most of the whole picture (docs/stability.md), and some of a part.
            self.assertGreater(besides, resources.SPARE_MEMORY * 400e6)
        # 1080p by 2^20 samples took 1100 s in however many parts.
        self.assertGreater(resources.merge_seconds(1920 * 1080, 2**20 / 64), 1100)
        self.assertGreater(resources.merge_seconds(10**6, 100, layers=True), resources.merge_seconds(10**6, 100))
        self.assertAlmostEqual(resources.merge_seconds(10**6, 0), resources.START + resources.WARNING)

    def test_learning(self):
        learns = resources.render_memory(self.probe, 2, resources.learner_bytes(resources.GUIDE_CEILING))
        renders = resources.render_memory(self.probe, 2, resources.guide_bytes(None, resources.GUIDE_CEILING))
        # What a guide of 24 MB was measured to take, and records.
        self.assertGreater(learns - resources.render_memory(self.probe, 2, 0), 1.9e9)
        self.assertGreater(learns, renders)
        self.assertGreater(resources.guide_merge_memory(24e6), 2 * 1.4e9)
        self.assertGreater(resources.guide_merge_seconds(24e6, 100), resources.guide_merge_seconds(24e6, 2))

    def test_data_sets(self):
        """By the finest grid of the recipe, as recipes have it."""
        memory = resources.dataset_memory
        folder = CLUSTER.parents[1] / "datasets"
        self.assertGreater(memory((folder / "fine.toml").read_text()), resources.SPARE_MEMORY * 13e9)
        self.assertEqual(memory("grids = [8, 45,\n 11]"), memory((folder / "default.toml").read_text()))
        self.assertEqual(memory('name = "no grids"'), memory("grids = [16]"))
        self.assertGreaterEqual(memory(""), resources.SPARE_MEMORY * resources.DATASET_BASE)

    def test_division(self):
        for spp, parts, expected in [(4096, 64, (1, 64)), (4096, 10, (1, 10)), (1024, 64, (4, 16)), (1024, 20, (2, 10)), (1, 3, (3, 1))]:
            self.assertEqual(resources.division(spp, parts), expected)

    def test_as_slurm_has_them(self):
        self.assertEqual([resources.megabytes(size) for size in (1, 2**30, 2**30 + 1)], ["256M", "1024M", "1025M"])
        self.assertEqual([resources.limit(time) for time in (1, 600, 601, 90000)], ["0:10:00", "0:10:00", "0:11:00", "25:00:00"])

    def test_arrays(self):
        job = Job("render.sbatch", [], "render", "1M", "1", tasks=2001)
        self.assertEqual(job.arrays(1000), [(0, 1000), (1000, 1000), (2000, 1)])
        self.assertEqual(Job("merge.sbatch", [], "merge", "1M", "1").arrays(1000), [(0, None)])


if __name__ == "__main__":
    unittest.main()

"""Progress, exceptions, Ctrl-C, Python's other threads, and the command."""

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import fanal

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals are sent in another way there")


class Enough(Exception):
    pass


def test_progress_is_told(scene):
    told = []
    image = fanal.render(scene("cornell"), time=1.0, size=(32, 32), guide="none", progress=told.append)
    assert len(told) >= 2 and told[-1].fraction == 1.0
    fractions = [report.fraction for report in told if report.fraction is not None]
    assert fractions == sorted(fractions) and all(0.0 <= fraction <= 1.0 for fraction in fractions)
    assert [r.samples for r in told] == sorted(r.samples for r in told) and told[-1].samples > 32 * 32
    assert "spp" in told[-1].reached and told[-1].message == "rendering" and told[-1].seconds > 0.0
    assert np.isfinite(image).all()


def test_exceptions_of_the_callback_end_the_render(scene, endless):
    def stop(report):
        raise Enough("enough")

    for guide in ("none", "neural"):
        with pytest.raises(Enough, match="enough"):
            fanal.render(scene("cornell"), spp=endless, guide=guide, progress=stop)
    # One at the very end counts too.
    with pytest.raises(Enough):
        fanal.render(scene("cornell"), spp=1, size=(8, 8), guide="none", progress=stop)
    assert fanal.render(scene("cornell"), spp=1, size=(8, 8), guide="none").shape == (8, 8, 3)


def test_false_ends_the_render_and_keeps_the_picture(scene, endless):
    def stop(report):
        return report.samples == 0

    result = fanal.render_full(scene("cornell"), spp=endless, size=(64, 64), guide="none", progress=stop)
    assert result.interrupted and result.image.max() > 0.0 and "interrupted" in repr(result)
    assert 0 < result.statistics["spp"] < endless
    none = fanal.render_full(scene("cornell"), spp=2, size=(8, 8), guide="none", progress=lambda report: None)
    assert not none.interrupted


def test_other_threads_run_meanwhile(scene):
    count, ended = 0, threading.Event()

    def tick():
        nonlocal count
        while not ended.wait(0.005):
            count += 1

    other = threading.Thread(target=tick)
    other.start()
    fanal.render(scene("cornell"), time=1.0, size=(32, 32), guide="none")
    ended.set()
    other.join()
    assert count >= 10


CAUGHT = """
import sys, fanal
print("begun", flush=True)
try:
    fanal.render(sys.argv[1], spp=1 << 22, progress=lambda p: p.samples and print("traced", flush=True), checkpoint=sys.argv[2])
except KeyboardInterrupt:
    image = fanal.render(sys.argv[1], spp=1, size=(8, 8), guide="none")
    print("caught", image.shape, flush=True)
"""
UNCAUGHT = "import sys, fanal; fanal.render(sys.argv[1], spp=1 << 22, progress=lambda p: p.samples and print('traced', flush=True))"


def interrupted(words, until):
    """Runs a command, sends Ctrl-C when a line of its stdout is `until`; returns exit code, stdout and stderr."""
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            for line in process.stdout:
                if line.strip() == until:
                    break
            process.send_signal(signal.SIGINT)
            out, told = process.communicate(timeout=60)
        finally:
            process.kill()
        return process.returncode, out, told


@posix
def test_ctrl_c_is_an_exception(tmp_path, scene):
    kept = tmp_path / "kept.part"
    code, out, told = interrupted([sys.executable, "-c", CAUGHT, scene("cornell"), str(kept)], "traced")
    assert code == 0 and "caught (8, 8, 3)" in out, told
    assert kept.stat().st_size > 0
    code, _, told = interrupted([sys.executable, "-c", UNCAUGHT, scene("cornell")], "traced")
    assert code == -signal.SIGINT and told.rstrip().endswith("KeyboardInterrupt")


@posix
def test_ctrl_c_ends_the_command_with_its_picture(tmp_path, scene, command, endless):
    out = tmp_path / "out.exr"
    words = command("render", scene("cornell"), "-o", out, "--spp", endless, "--size", "32x32", "--guide", "none")
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            for _ in range(600):
                if out.exists():
                    break
                time.sleep(0.1)
            process.send_signal(signal.SIGINT)
            _, told = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 75 and "interrupted after" in told and "Traceback" not in told
    assert fanal.read_image(out).max() > 0.0


def test_the_command_is_the_program(tmp_path, scene, command, program):
    def run(*words):
        return subprocess.run(command(*words), capture_output=True, text=True, timeout=120)

    version = run("--version")
    assert (version.returncode, version.stdout) == (0, f"fanal {fanal.__version__}\n") and version.stdout == program("--version")
    assert run("render", "--help").stdout == program("render", "--help")
    module = subprocess.run([sys.executable, "-m", "fanal", "--version"], capture_output=True, text=True, timeout=120)
    assert (module.returncode, module.stdout) == (0, version.stdout)
    usage = run("render", scene("cornell"))
    assert usage.returncode == 2 and "--output" in usage.stderr and "Traceback" not in usage.stderr
    failed = run("render", "no-such-scene.json", "-o", tmp_path / "a.exr")
    assert failed.returncode == 1 and failed.stderr.startswith("fanal: ") and "no-such-scene.json" in failed.stderr
    ours, theirs = tmp_path / "ours.exr", tmp_path / "theirs.exr"
    fixed = ["render", scene("door-ajar"), "--spp", 16, "--size", "32x24", "--quiet", "-o"]
    rendered = run(*fixed, ours)
    program(*fixed, theirs)
    assert rendered.returncode == 0 and rendered.stderr == ""
    assert fanal.read_image(ours).tobytes() == fanal.read_image(theirs).tobytes()

"""What all tests share: scenes, the program to compare with, and short commands."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCENES = Path(__file__).resolve().parents[3] / "scenes"
ENDLESS = 1 << 22
"""Samples per pixel that no test waits for."""


@pytest.fixture(scope="session")
def scene():
    """The path of one of our scenes."""
    return lambda name: str(SCENES / name)


@pytest.fixture
def program():
    """Runs the program that was built apart from the wheel."""

    def run(*words):
        command = [os.environ["FANAL_PROGRAM"], *map(str, words)]
        return subprocess.run(command, check=True, capture_output=True, text=True, timeout=300).stdout

    return run


@pytest.fixture
def command():
    """The command that the wheel installs, as a list of words."""
    name = "fanal.exe" if sys.platform == "win32" else "fanal"
    return lambda *words: [str(Path(sys.executable).parent / name), *map(str, words)]


@pytest.fixture
def endless():
    return ENDLESS

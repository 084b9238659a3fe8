"""The command ``fanal``: the program's own command line, run inside of Python.

It is the same code as in the program, so the wheel holds it once.
"""

import signal
import sys

from . import _fanal


def main() -> int:
    """Runs the command line of this process; returns its exit code."""
    # The program handles Ctrl-C itself. Where it does not, as while reading a scene, the process ends as the program's would.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _fanal.main(["fanal", *sys.argv[1:]])

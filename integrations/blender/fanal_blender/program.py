"""Finding and running the program."""

import os
import re
import shutil
import signal
import subprocess
import threading

# A line of progress: "learning, iteration 6: 12 %, 131 spp, 20 s".
_PART = re.compile(r"(\d+(?:\.\d+)?) %")
# How many lines of a failed run are shown.
_LAST = 12


def find(configured):
    """Path of the program: the configured one, or the one on PATH; `FileNotFoundError` says what to do."""
    path = os.path.expanduser(configured) if configured else shutil.which("fanal")
    if not path or not os.path.isfile(path):
        where = f"there is no program {configured}" if configured else "fanal is not on PATH"
        raise FileNotFoundError(f"{where}: set its path in the add-on's preferences")
    return path


class Run:
    """A running `fanal render`, whose messages are read by a thread."""

    def __init__(self, program, scene, picture, arguments=()):
        # A line of progress comes every ten seconds where there is no terminal.
        command = [program, "render", scene, "-o", picture, *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace")
        self.picture, self.stopped = picture, False
        self.lines, self.progress = [], 0.0
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self):
        for line in self.process.stderr:
            line = line.strip()
            self.lines.append(line)
            found = _PART.search(line)
            if found:
                self.progress = min(float(found.group(1)) / 100.0, 1.0)

    @property
    def message(self):
        """The last thing that it said."""
        return self.lines[-1].removeprefix("fanal: ") if self.lines else ""

    def is_running(self):
        return self.process.poll() is None

    def stop(self):
        """Ends it early, however often it is called: a second signal would end it before what there is of the picture is written."""
        if self.is_running() and not self.stopped:
            self.stopped = True
            self.process.send_signal(signal.SIGINT if os.name != "nt" else signal.SIGTERM)

    def finish(self):
        """Waits for its end; raises `RuntimeError` with its last words where it failed. 75 is the exit code of one that was stopped.
        While it still reads the scene, and on Windows always, that ends it at once: the picture, if there is one, is then the last
        that it wrote on the way."""
        code = self.process.wait()
        self.reader.join()
        self.process.stderr.close()
        ended = self.stopped and (os.name == "nt" or code == -signal.SIGINT)
        if code not in (0, 75) and not ended:
            raise RuntimeError("\n".join(self.lines[-_LAST:]) or f"fanal ended with code {code}")

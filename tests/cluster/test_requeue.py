"""integrations/cluster/requeue beside a scontrol that writes down how it is called and ends the job, as Slurm does."""

import os
import pathlib
import signal
import subprocess
import tempfile
import time
import unittest

REQUEUE = pathlib.Path(__file__).resolve().parents[2] / "integrations/cluster/requeue"

SCONTROL = """#!/bin/sh
echo "$@" >> "$CALLS"
[ -z "$REFUSES" ] || exit 1
kill -TERM $PPID
"""
# Says that it has begun, and saves what it has when it is told to end.
COMMAND = "trap 'echo saved; exit 75' TERM; echo begun; while :; do sleep 0.05; done"


class Requeue(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        scontrol = self.folder / "scontrol"
        scontrol.write_text(SCONTROL)
        scontrol.chmod(0o755)
        self.calls = self.folder / "calls"

    def start(self, command, **variables):
        path = f"{self.folder}:{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "CALLS": str(self.calls), "SLURM_JOB_ID": "42", "SLURM_RESTART_COUNT": "0", **variables}
        job = subprocess.Popen([REQUEUE, "bash", "-c", command], env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)
        self.addCleanup(self.end, job)
        return job

    def end(self, job):
        """Whatever is left of the job."""
        try:
            os.killpg(job.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        job.stdout.close()

    def begun(self, **variables):
        job = self.start(COMMAND, **variables)
        self.assertEqual(job.stdout.readline(), "begun\n")
        return job

    def called(self):
        return self.calls.read_text().splitlines() if self.calls.exists() else []

    def test_the_status_is_that_of_the_command(self):
        for status in (0, 1, 2, 137):
            self.assertEqual(self.start(f"exit {status}").wait(timeout=60), status)
        self.assertEqual(self.called(), [])

    def test_a_warning_is_passed_on_and_the_job_put_back(self):
        job = self.begun()
        job.send_signal(signal.SIGUSR1)
        self.assertEqual(job.wait(timeout=60), 75)
        self.assertEqual(job.stdout.read(), "saved\n")
        self.assertEqual(self.called(), ["requeue 42"])

    def test_a_second_warning_is_not_a_second_signal(self):
        job = self.start("trap 'echo told' TERM; echo begun; for i in $(seq 40); do sleep 0.05; done; exit 75")
        self.assertEqual(job.stdout.readline(), "begun\n")
        for _ in range(3):
            job.send_signal(signal.SIGUSR1)
            time.sleep(0.2)
        self.assertEqual(job.wait(timeout=60), 75)
        self.assertEqual(job.stdout.read(), "told\n")

    def test_what_ends_the_command_alone_puts_the_job_back(self):
        self.assertEqual(self.start("exit 75").wait(timeout=60), 75)
        self.assertEqual(self.called(), ["requeue 42"])

    def test_what_has_nothing_to_save_yet_puts_the_job_back(self):
        """A command that reads its scene does not handle signals yet, which end it."""
        for status in (128 + signal.SIGINT, 128 + signal.SIGTERM):
            self.assertEqual(self.start(f"exit {status}").wait(timeout=60), 75)
        self.assertEqual(self.called(), ["requeue 42"] * 2)
        job = self.start("echo begun; while :; do sleep 0.05; done")
        self.assertEqual(job.stdout.readline(), "begun\n")
        job.send_signal(signal.SIGUSR1)
        self.assertEqual(job.wait(timeout=60), 75)
        self.assertEqual(self.called(), ["requeue 42"] * 3)

    def test_what_slurm_ends_is_not_put_back(self):
        # The signal is not passed on: Slurm sends it to the command itself, here a moment later.
        job = self.begun()
        job.send_signal(signal.SIGTERM)
        time.sleep(0.3)
        self.assertIsNone(job.poll())
        command = subprocess.run(["pgrep", "-P", str(job.pid)], check=True, stdout=subprocess.PIPE, text=True).stdout.split()
        os.kill(int(command[0]), signal.SIGTERM)
        self.assertEqual(job.wait(timeout=60), 75)
        self.assertEqual(self.called(), [])

    def test_a_signal_does_not_hide_that_the_command_is_done(self):
        job = self.start("trap 'exit 0' TERM; echo begun; while :; do sleep 0.05; done")
        self.assertEqual(job.stdout.readline(), "begun\n")
        job.send_signal(signal.SIGUSR1)
        self.assertEqual(job.wait(timeout=60), 0)
        self.assertEqual(self.called(), [])

    def test_a_job_that_gets_nowhere_is_given_up(self):
        self.assertEqual(self.start("exit 75", SLURM_RESTART_COUNT="3", FANAL_RESTARTS="3").wait(timeout=60), 1)
        self.assertEqual(self.called(), [])

    def test_where_users_may_not_requeue(self):
        self.assertEqual(self.start("exit 75", REFUSES="1").wait(timeout=60), 75)
        self.assertEqual(self.called(), ["requeue 42"])


if __name__ == "__main__":
    unittest.main()

"""Jobs of Slurm: the command line of each, and their submission one after the other."""

import os
import re
import shlex
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent

# Most tasks of an array as Slurm comes (MaxArraySize is one more).
USUAL_TASKS = 1000


class Job:
    """A script of this folder with what it asks for.

    `arguments` are the script's. `tasks` is the number of an array's tasks, None for a job without one, and `before` those of other arrays that
    come before. `after` are the jobs that have to succeed before.
    """

    def __init__(self, script, arguments, name, memory, time, cpus=1, tasks=None, after=(), before=0):
        self.script = script
        self.arguments = arguments
        self.name = name
        self.memory = memory
        self.time = time
        self.cpus = cpus
        self.tasks = tasks
        self.after = after
        self.before = before

    def arrays(self, most):
        """Tasks before, and tasks, of each array where Slurm takes `most` in one."""
        if self.tasks is None:
            return [(self.before, None)]
        return [(self.before + first, min(most, self.tasks - first)) for first in range(0, self.tasks, most)]

    def command(self, tasks, logs, options, after):
        """The call of sbatch for `tasks` of its tasks, where `after` are numbers of jobs (or what stands for them)."""
        words = ["sbatch", "--parsable", f"--job-name={self.name}", f"--mem={self.memory}", f"--time={self.time}"]
        words += [f"--cpus-per-task={self.cpus}", f"--output={logs}/%x-{'%A_%a' if tasks else '%j'}.log"]
        if tasks:
            words.append(f"--array=1-{tasks}")
        if after:
            words += [f"--dependency=afterok:{':'.join(after)}", "--kill-on-invalid-dep=yes"]
        return [*words, *options, str(HERE / self.script), *map(str, self.arguments)]


def largest_array():
    """Most tasks that Slurm takes in an array here."""
    answer = subprocess.run(["scontrol", "show", "config"], check=True, stdout=subprocess.PIPE, universal_newlines=True)
    found = re.search(r"MaxArraySize\s*=\s*(\d+)", answer.stdout)
    return int(found.group(1)) - 1 if found else USUAL_TASKS


def submit(jobs, logs, options, programs):
    """Submits jobs in their order. `programs` are variables of the scripts."""
    most, numbers = largest_array(), {}
    for job in jobs:
        after = [number for before in job.after for number in numbers[before]]
        numbers[job] = []
        for before, tasks in job.arrays(most):
            environment = {**os.environ, **programs, "FANAL_CLUSTER": str(HERE), "FANAL_TASKS_BEFORE": str(before)}
            command = job.command(tasks, logs, options, after)
            answer = subprocess.run(command, check=True, env=environment, stdout=subprocess.PIPE, universal_newlines=True)
            numbers[job].append(answer.stdout.strip().split(";")[0])
            count = f", {tasks} tasks" if tasks else ""
            print(f"{job.name}: job {numbers[job][-1]}{count}, {job.memory} and {job.time} each")


def show(jobs, logs, options, programs):
    """Prints what `submit` would call, with names in place of the numbers of jobs, for a shell to read."""
    for name, value in {**programs, "FANAL_CLUSTER": str(HERE)}.items():
        print(f"export {name}={shlex.quote(value)}")
    print(f"mkdir -p {shlex.quote(str(logs))}")
    numbers = {}
    for job in jobs:
        after = [number for before in job.after for number in numbers[before]]
        numbers[job] = []
        for before, tasks in job.arrays(USUAL_TASKS):
            variable = f"{job.name.replace('-', '_')}{before or ''}"
            numbers[job].append(f"${variable}")
            words = [word if word.startswith("--dependency=") else shlex.quote(word) for word in job.command(tasks, logs, options, after)]
            print(f"{variable}=$({f'FANAL_TASKS_BEFORE={before} ' if before else ''}{' '.join(words)})")

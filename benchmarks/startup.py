"""Start-up of the import, of the help, of every model and of every command, in new processes.

`python -m benchmarks startup` prints for each command the time of its first run ever, with an empty cache of compiled
code (`OMNISIGHT_CACHE`), and of its second run, with the processor time of both. The processor time is nearly the same
on a machine with other load. `--only calibrate view` measures some commands.
"""

import argparse
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.race import Race, table
from benchmarks.startup_commands import COMMANDS, write_inputs

IMPORTS = (
    ("import omnisight, fresh process", "import omnisight", 0.25),
    ("omnisight --help, fresh process", "from omnisight.cli import main; main(['--help'])", 0.3),
    (
        "first project of a model, fresh process, warm cache",
        "import omnisight as om; om.model_class('{name}').example().project([[0.1, 0.2, 1.0]])",
        1.0,
    ),
)
RUNS = 3
# Seconds of the second run.
TARGETS = {"inspect": 0.8, "view": 0.8, "detect": 0.8}


class Duration(NamedTuple):
    """Wall time and processor time of a process and its children, seconds."""

    wall: float
    processor: float


def main(arguments: Sequence[str]) -> None:
    """Print the table of the imports, and that of the commands."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks startup", description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="COMMAND", choices=COMMANDS, help="measure these commands")
    chosen = parser.parse_args(arguments).only
    if not chosen:
        print(table(import_races()) + "\n", flush=True)
    print(f"Load before: {os.getloadavg()[0]:.1f}, on {os.cpu_count()} cores.\n")
    print("| command | first run ever, s | processor | second run, s | processor | at most, s | |\n" + "|---" * 7 + "|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder)
        for command in chosen or COMMANDS:
            print(row(command, *times(command, folder)), flush=True)
    print(f"\nLoad after: {os.getloadavg()[0]:.1f}.")


def import_races() -> list[Race]:
    """Return the times of the imports and of the first projection, of the slowest model, beside their limits."""
    import omnisight as om

    races: list[Race] = []
    for work, code, limit in IMPORTS:
        slowest, name_of_slowest = 0.0, ""
        for name in om.model_names() if "{name}" in code else ("",):
            command = [sys.executable, "-c", code.replace("{name}", name)]
            run(command)
            taken = median(run(command).wall for _ in range(RUNS))
            if taken > slowest:
                slowest, name_of_slowest = taken, name
        label = f"{work} ({name_of_slowest})" if name_of_slowest else work
        races.append(Race(label, slowest, limit, f"{limit:g} s", 1))
    return races


def times(command: str, folder: Path) -> tuple[Duration, Duration]:
    """Return the time of the first run with an empty cache, and the median of further runs."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "OMNISIGHT_CACHE": cache}
        environment["PYTHONPATH"] = str(Path(__file__).parents[1] / "src")
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # installers write the bytecode of all modules
        first, *others = [once(command, folder, environment) for _ in range(1 + RUNS)]
    return first, Duration(median(t.wall for t in others), median(t.processor for t in others))


def once(command: str, folder: Path, environment: Mapping[str, str]) -> Duration:
    """Run a command that writes to a new folder OUT."""
    output = folder / "OUT"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    # Detections are cached as well: they are not part of the start.
    shutil.rmtree(Path(environment["OMNISIGHT_CACHE"]) / "detections", ignore_errors=True)
    return run([sys.executable, "-m", "omnisight", *shlex.split(COMMANDS[command])], folder, environment)


def run(command: Sequence[str], folder: Path | None = None, environment: Mapping[str, str] | None = None) -> Duration:
    """Run a process and return its times; exit with its message if it fails."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{shlex.join(command)}: exit status {done.returncode}\n{done.stdout}{done.stderr}")
    return Duration(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def row(command: str, first: Duration, second: Duration) -> str:
    """Return the row of a command."""
    target = TARGETS.get(command)
    reached = "" if target is None else "yes" if second.wall <= target else "**no**"
    figures = f"{first.wall:.1f} | {first.processor:.1f} | {second.wall:.2f} | {second.processor:.2f}"
    return f"| {command} | {figures} | {'' if target is None else f'{target:g}'} | {reached} |"

"""Run a method in a process of its own, so that its time and memory are not those of other methods."""

import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
MEGABYTE = 1e6


def run_module(module: str, arguments: Sequence[str]) -> list[list[str]]:
    """Run `python -m module` and return the words of the lines that it prints.

    Raises
    ------
    RuntimeError
        If it fails, with the end of what it printed.
    """
    path = os.pathsep.join([str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}\n{done.stderr[-2000:]}")
    return [line.split() for line in done.stdout.splitlines() if line]


def peak_memory() -> float:
    """Return the largest resident memory of this process and of those that it started, MB.

    `ru_maxrss` of this process is not used: Linux keeps that of the parent at the start of a process.
    """
    rows = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    own = next(float(row[1]) for row in rows if row[0] == "VmHWM:")
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return max(own, children) * 1024 / MEGABYTE

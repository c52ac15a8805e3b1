"""Progress on stderr, so that stdout contains the result only."""

import sys
import time
from collections.abc import Generator
from contextlib import contextmanager

from omnisight.cli._output import is_quiet, is_verbose
from omnisight.compilation import watch_compilation
from omnisight.display import rounded
from omnisight.progress import Progress, no_progress

# Time over which the speed is averaged, seconds: batches report each shard of images, and a shard can take a minute.
SPEED_PERIOD_S = 600.0


@contextmanager
def progress() -> Generator[Progress]:
    """Show the stages: their times if verbose, otherwise progress bars if stderr is a terminal; nothing if quiet."""
    if is_verbose():
        with _stage_times() as report:
            yield report
    elif is_quiet() or not sys.stderr.isatty():
        yield no_progress
    else:
        with _bars() as report:
            yield report


@contextmanager
def _bars() -> Generator[Progress]:
    """Show a progress bar per stage, with its steps per second and the time left, and one while code is compiled."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn
    from rich.progress import Progress as ProgressBars
    from rich.progress import TimeRemainingColumn as TimeLeft
    from rich.text import Text

    class Speed(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text("" if task.speed is None else f"{rounded(task.speed, 3)}/s")

    columns = (TextColumn("{task.description:<24}"), BarColumn(), MofNCompleteColumn(), Speed(), TimeLeft())
    console = Console(stderr=True)
    with ProgressBars(*columns, console=console, transient=True, speed_estimate_period=SPEED_PERIOD_S) as bars:
        tasks = {}
        compiling, of_code = 0, bars.add_task("compile code (first run)", total=None, visible=False)

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total, completed=done)
            bars.update(tasks[stage], completed=done, total=total)

        def report_compilation(function: str, seconds: float | None) -> None:
            nonlocal compiling
            starts = seconds is None
            compiling += 1 if starts else -1
            bars.update(of_code, visible=compiling > 0, advance=0 if starts else 1, refresh=starts)

        with watch_compilation(report_compilation):
            yield report


@contextmanager
def _stage_times() -> Generator[Progress]:
    """Print each stage when the next one begins: its time, and how much was done."""
    stages: list[tuple[str, float, int]] = []

    def finish() -> None:
        if stages:
            name, start, done = stages.pop()
            print(f"{name:<32} {time.perf_counter() - start:8.2f} s, {done} steps", file=sys.stderr, flush=True)

    def report(stage: str, done: int, total: int) -> None:
        if stages and stages[0][0] == stage:
            stages[0] = (stage, stages[0][1], done)
            return
        finish()
        stages.append((stage, time.perf_counter(), done))

    def report_compilation(function: str, seconds: float | None) -> None:
        if seconds is not None:
            print(f"{'compile ' + function:<32} {seconds:8.2f} s, first run", file=sys.stderr, flush=True)

    try:
        with watch_compilation(report_compilation):
            yield report
    finally:
        finish()

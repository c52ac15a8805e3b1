"""Progress on stderr, so that stdout stays what was asked for."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import Protocol


class Report(Protocol):
    """Called with a stage, how much of it is done, and how much there is."""

    def __call__(self, stage: str, done: int, total: int) -> None: ...


@contextmanager
def progress(quiet: bool) -> Generator[Report]:
    """Show a bar per stage while the block runs; nothing when quiet or where stderr is no terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage, done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description:<24}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield report

"""Reports of the functions that are compiled, which takes seconds when a command runs for the first time."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import Protocol


class CompilationReport(Protocol):
    """Called with the name of a function when its compilation starts, and again with the time it took, seconds."""

    def __call__(self, function: str, seconds: float | None) -> None: ...


_reports = list[CompilationReport]()


@contextmanager
def watch_compilation(report: CompilationReport) -> Generator[None]:
    """Call a function at the start and the end of each compilation of this process, from any thread."""
    _reports.append(report)
    try:
        yield
    finally:
        _reports.remove(report)


def report_compilation(function: str, seconds: float | None) -> None:
    """Call the functions that watch the compilation."""
    for report in tuple(_reports):
        report(function, seconds)

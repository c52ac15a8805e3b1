"""Reports of the functions that are compiled, which takes seconds when a command runs for the first time.

A process compiles one function at a time, and waits for those that another process compiles. So the first run of a
command runs parts of its code in other processes: `python -m omnisight.compilation module:function`.
"""

import gc
import importlib
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from subprocess import Popen


class CompilationReport(Protocol):
    """Called with the name of a function when its compilation starts, and again with the time it took, seconds."""

    def __call__(self, function: str, seconds: float | None) -> None: ...


_reports = list[CompilationReport]()
# Processes that compile, also after this process needed their code: Popen warns if it is deleted before they end.
_processes: "list[Popen[bytes]]" = []


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


@contextmanager
def compile_in_parallel(parts: Callable[[], Sequence[str]]) -> Generator[None]:
    """Start a process on each other core, for a part of the code each, when this process compiles anything.

    Parameters
    ----------
    parts
        Returns the functions that a process calls, see `start_processes`; the first ones if there are more than cores.
    """
    from omnisight.parallel import thread_count

    other_cores = thread_count() - 1

    def start(function: str, seconds: float | None) -> None:
        nonlocal other_cores
        if other_cores:
            count, other_cores = other_cores, 0
            _processes.extend(start_processes(*parts()[:count]))

    with watch_compilation(start):
        yield


def start_processes(*parts: str) -> "list[Popen[bytes]]":
    """Run functions without arguments in a process each; none if the program is not Python but a frozen application.

    Parameters
    ----------
    parts
        The functions, as "module:function".
    """
    from subprocess import DEVNULL, Popen

    if not sys.executable or getattr(sys, "frozen", False):
        return []
    started: list[Popen[bytes]] = []
    with suppress(OSError):
        for part in parts:
            command = [sys.executable, "-m", "omnisight.compilation", part]
            started.append(Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL))
    return started


if __name__ == "__main__":
    gc.disable()  # of no use in a process that ends after the compilation, and a fourteenth of its time
    module, name = sys.argv[1].split(":")
    getattr(importlib.import_module(module), name)()

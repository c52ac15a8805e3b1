"""The options of every command that control what it prints.

`main` adds them to the signature of each command. A command prints its report with `print`, which --json and --quiet
discard, and its JSON object with `write_json`.
"""

import functools
import inspect
import io
import json
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Annotated, Any, TextIO

from cyclopts import Parameter


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Options of every command.

    Attributes
    ----------
    json
        Print one JSON object on stdout, and nothing else there.
    quiet
        Print nothing but errors, and the object of --json.
    verbose
        Print all details and, on stderr, each step with its time.
    """

    json: Annotated[bool, Parameter(negative="")] = False
    quiet: Annotated[bool, Parameter(alias="-q", negative="")] = False
    verbose: Annotated[bool, Parameter(alias="-v", negative="")] = False


@dataclass(frozen=True)
class _Run:
    """The options of the running command, the stream of its result, and when it began."""

    options: OutputOptions
    stdout: TextIO
    start: float


_run: ContextVar[_Run | None] = ContextVar("_run", default=None)
_NO_OPTIONS = OutputOptions()


def _options() -> OutputOptions:
    """Return the options of the running command; the defaults outside of one."""
    run = _run.get()
    return _NO_OPTIONS if run is None else run.options


def is_json() -> bool:
    """Return whether the command prints a JSON object instead of its report."""
    return _options().json


def is_quiet() -> bool:
    """Return whether the command prints nothing but errors."""
    return _options().quiet


def is_verbose() -> bool:
    """Return whether the command prints all details."""
    return _options().verbose


def write_json(data: Mapping[str, Any]) -> None:
    """Print the JSON object of a command on stdout."""
    run = _run.get()
    print(json.dumps(data, indent=2, allow_nan=False), file=sys.stdout if run is None else run.stdout)


def warn(message: str) -> None:
    """Print a warning on stderr, unless quiet."""
    if not is_quiet():
        print(f"omnisight: warning: {message}", file=sys.stderr)


def elapsed() -> float:
    """Return the time since the command began, seconds."""
    run = _run.get()
    return 0.0 if run is None else time.perf_counter() - run.start


def with_output_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with the options of every command."""
    signature = inspect.signature(command)
    options = inspect.Parameter(
        "output_options",
        inspect.Parameter.KEYWORD_ONLY,
        default=OutputOptions(),
        annotation=Annotated[OutputOptions, Parameter(name="*", group="Output")],
    )

    @functools.wraps(command)
    def run(*arguments: Any, output_options: OutputOptions = OutputOptions(), **values: Any) -> None:
        with _printing(output_options):
            command(*arguments, **values)

    run.__dict__["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), options])
    return run


@contextmanager
def _printing(options: OutputOptions) -> Generator[None]:
    """Apply the options to what is printed inside."""
    if options.quiet and options.verbose:
        raise ValueError("--quiet and --verbose exclude each other")
    run = _Run(options, sys.stdout, time.perf_counter())
    used, token = time.process_time(), _run.set(run)
    try:
        with redirect_stdout(_Discarded() if options.json or options.quiet else sys.stdout):
            yield
        if options.verbose:
            processor = time.process_time() - used
            print(f"{'total':<24} {elapsed():8.2f} s, {processor:.2f} s of processor time", file=sys.stderr)
    finally:
        _run.reset(token)


class _Discarded(io.TextIOBase):
    """Stream that discards text of any characters."""

    def write(self, text: str, /) -> int:
        return len(text)

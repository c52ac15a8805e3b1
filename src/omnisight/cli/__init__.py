"""Command line: each module of this package whose name has no leading underscore is one command.

A command is the function named like its module; its signature defines the options, its docstring the help, and `GROUP`,
if the module has it, where the list of commands shows it. Commands import slow modules inside the function, so that
`--help` is fast. The options --json, --quiet and --verbose are those of `_output.py` in every command.
"""

import atexit
import contextlib
import gc
import importlib
import os
import pkgutil
import sys
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from cyclopts import App

EXIT_FAILED, EXIT_INPUT, EXIT_INTERRUPTED = 1, 2, 130

# Objects after which Python searches for garbage, in place of 700: a command and numba make 150,000 objects that stay,
# and the searches among them take a tenth of the time of a short command.
COLLECTION_THRESHOLD = 200_000

GROUPS = ("Calibration", "Cameras", "Views", "Geometry")

HELP = """Calibrate fisheye, mirror and other omnidirectional cameras, and turn their images into views.

Exit status: 0 success, 1 internal error, 2 invalid input or option, 130 interrupted.
"""


def application(first: str = "") -> "App":
    """Return the program with all commands, or with only the command that the first argument names."""
    from cyclopts import App, Group, Parameter

    import omnisight
    from omnisight.cli._output import with_output_options

    if first == "--install-completion":  # imports all extensions
        from omnisight.cli._completion import CompletedApp as App

    app = App(
        name="omnisight",
        help=HELP,
        version=omnisight.__version__,
        help_format="markdown",
        # No --empty-fix, and no default in the help if an option is off without it.
        default_parameter=Parameter(
            negative_iterable=(),
            show_default=lambda value: None if value is None or value is False or value == () else str(value),
        ),
        suppress_keyboard_interrupt=False,
    )
    groups = {name: Group(name, sort_key=index) for index, name in enumerate(GROUPS)}
    commands = {name.replace("_", "-"): name for name in _modules()}
    if first not in commands:
        app.register_install_completion_command(help="Complete commands and options in the shell with the Tab key.")
    for command in [first] if first in commands else commands:
        module = importlib.import_module(f"{__name__}.{commands[command]}")
        group = groups.get(getattr(module, "GROUP", ""))
        app.command(with_output_options(getattr(module, commands[command])), name=command, group=group)
    return app


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; raise `SystemExit` with an exit status other than 0."""
    from omnisight.persistent_interruption import persistent_interruption

    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
    tokens = [token for token in tokens if token != "--debug"]
    with persistent_interruption() as interruption:
        try:
            _run(tokens, next(iter(tokens), "") if arguments is None else "")
        except BrokenPipeError:  # the reader, such as `head`, has closed the pipe
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(0)
        except (KeyboardInterrupt, Exception) as error:
            # C code, such as a compiled loop, can replace the exception of Ctrl-C by another one.
            if interruption.is_pending or isinstance(error, KeyboardInterrupt):
                interruption.is_pending = False
                _print_error(_interruption(error))
                sys.exit(EXIT_INTERRUPTED)
            status, message = _failure(error, debug)
            _print_error(_meant_command(tokens) or message)
            sys.exit(status)


def _meant_command(tokens: list[str]) -> str:
    """Return the message if the two words of a command were typed apart, such as `calibrate rig`; empty if not."""
    words = tokens[:2]
    if len(words) < 2 or "_".join(words) not in _modules() or os.path.exists(words[1]):
        return ""
    return f"{words[1]}: no such file or folder (did you mean omnisight {'-'.join(words)}?)"


def _modules() -> list[str]:
    """Return the names of the modules of the commands."""
    return [found.name for found in pkgutil.iter_modules(__path__) if not found.name.startswith("_")]


def _run(tokens: list[str], first: str) -> None:
    """Run the command line; `first` is the only command that it needs, if not empty."""
    app = application(first)
    try:
        os.getcwd()
    except FileNotFoundError:  # numba needs an existing working directory
        os.chdir(os.sep)
    app(tokens, exit_on_error=False, print_error=False)


def _failure(error: BaseException, debug: bool) -> tuple[int, str]:
    """Return the exit status and the message of an error; raise it for `debug`, unless it is of the options."""
    from cyclopts import CycloptsError

    if isinstance(error, CycloptsError):
        from omnisight.cli._option_errors import option_error

        return EXIT_INPUT, option_error(error)
    if debug:
        raise error
    if isinstance(error, OSError) and error.filename:
        from omnisight.extensions import file_error

        return EXIT_INPUT, f"{error.filename}: {file_error(error.filename, error)}"
    if isinstance(error, ValueError | OSError):
        return EXIT_INPUT, str(error)
    return EXIT_FAILED, f"internal error: {type(error).__name__}: {error} (--debug prints the traceback)"


def run() -> NoReturn:
    """Run the command line of this process and end it.

    The interpreter is not finalized: to free all modules and compiled code takes 0.1 s, and the system frees them too.
    """
    gc.set_threshold(COLLECTION_THRESHOLD)
    status = 0
    try:
        main()
    except SystemExit as stop:
        status = int(stop.code or 0)
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    with contextlib.suppress(BrokenPipeError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(status)


def _interruption(error: BaseException) -> str:
    """Return the message of an interruption, with the unfinished files that can be used."""
    return "; ".join(("interrupted", *getattr(error, "__notes__", ())))


def _print_error(message: str) -> None:
    print(f"omnisight: {message}", file=sys.stderr)

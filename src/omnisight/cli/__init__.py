"""The command line: each file of this folder that does not begin with an underscore holds one command.

A command is the function named as its file; its signature makes its options, its docstring the help. What is slow to
import, a command imports inside.
"""

import importlib
import os
import pkgutil
import sys

EXIT_FAILED, EXIT_INPUT, EXIT_INTERRUPTED = 1, 2, 130

HELP = """Calibrate any camera that sees more than a pinhole can, and turn its images into views.

Exit status: 0 done, 1 a fault in omnisight, 2 something to mend in what it was given, 130 interrupted.
"""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    from cyclopts import App, CycloptsError

    import omnisight

    tokens = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in tokens
    tokens = [token for token in tokens if token != "--debug"]
    app = App(
        name="omnisight",
        help=HELP,
        version=omnisight.__version__,
        help_format="markdown",
        suppress_keyboard_interrupt=False,
    )
    for found in pkgutil.iter_modules(__path__):
        if not found.name.startswith("_"):
            app.command(
                getattr(importlib.import_module(f"{__name__}.{found.name}"), found.name),
                name=found.name.replace("_", "-"),
            )
    try:
        os.getcwd()
    except FileNotFoundError:  # deleted; compilers and others ask where they are
        os.chdir(os.sep)
    try:
        app(tokens, exit_on_error=False)
    except CycloptsError:  # said already
        sys.exit(EXIT_INPUT)
    except BrokenPipeError:  # whoever read the output has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except KeyboardInterrupt:
        _say("interrupted")
        sys.exit(EXIT_INTERRUPTED)
    except (ValueError, OSError) as error:
        if debug:
            raise
        _say(f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error))
        sys.exit(EXIT_INPUT)
    except Exception as error:
        if debug:
            raise
        _say(f"a fault in omnisight: {type(error).__name__}: {error} (--debug shows where)")
        sys.exit(EXIT_FAILED)


def _say(message: str) -> None:
    print(f"omnisight: {message}", file=sys.stderr)

"""Messages of arguments that a command does not accept."""

import re
from difflib import get_close_matches

from cyclopts import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

# The options without a command, and the one that is not an argument of the commands.
PROGRAM_OPTIONS, HELP = ("help", "version", "install-completion"), "help"
# Types of numbers in messages.
NUMBERS: dict[object, str] = {int: "an integer", float: "a number"}
# Other names of codecs: the closest of ours may be another codec, h264 for h265.
CODECS = {"h265": "hevc", "h.265": "hevc", "x265": "hevc", "avc": "h264", "h.264": "h264", "x264": "h264"}


def option_error(error: CycloptsError) -> str:
    """Return the message of an error of the options."""
    message = str(error)
    if isinstance(error, CoercionError) and error.argument is not None and error.argument.parameter.converter:
        message = str(error.__cause__)  # without the name of the option, which the messages of converters contain
    elif isinstance(error, CoercionError) and error.token is not None and error.target_type in NUMBERS:
        message = (
            f"{error.token.keyword or error.token.value}: {error.token.value!r} is not {NUMBERS[error.target_type]}"
        )
    elif isinstance(error, CoercionError) and error.token is not None and error.token.value.lower() in CODECS:
        value, codec = error.token.value, CODECS[error.token.value.lower()]
        message = f"{error.token.keyword} {value}: this codec is called {codec} here"
    if isinstance(error, UnusedCliTokensError):
        message = _unused_arguments(error)
    if isinstance(error, UnknownOptionError):
        message = _unknown_option(error)
    if isinstance(error, UnknownCommandError) and error.unused_tokens and error.unused_tokens[0].startswith("-"):
        message = _option_before_command(error.unused_tokens[0])
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        message = f"{error.argument.name} is missing; {_command(error)} --help describes it"
        if error.keyword is not None:
            count, _ = error.argument.token_count()
            message = f"{error.keyword} needs a value; write {error.keyword}=VALUE if it begins with a dash"
            if count > 1:
                message = f"{error.keyword} needs {count} values; {_command(error)} --help describes them"
            message = _negative_length(error, error.keyword) or message
    return message


def _negative_length(error: MissingArgumentError, keyword: str) -> str:
    """Return the message if the missing value is a negative length, which has the form of an option; empty if not."""
    from omnisight.targets.length import UNITS_PER_METRE

    typed = error.root_input_tokens or []
    at = typed.index(keyword) + 1 + len(error.tokens_so_far) if keyword in typed else len(typed)
    values = [value for value in typed[at : at + 1] if re.fullmatch(rf"-[\d.]+({'|'.join(UNITS_PER_METRE)})", value)]
    return f"{keyword}: the length {values[0]!r} must be positive" if values else ""


def _option_before_command(typed: str) -> str:
    """Return the message of an option in the place of the command."""
    meant = get_close_matches(typed.lstrip("-"), PROGRAM_OPTIONS, n=1)
    advice = f" (did you mean --{meant[0]}?)" if meant else f": options follow the command: omnisight COMMAND {typed}"
    return f"unknown option {typed}{advice}"


def _unknown_option(error: UnknownOptionError) -> str:
    """Return the message of an option that the command does not have, with the one that is meant.

    Names are compared without their dashes, which all share. Of close ones, that with most of the typed words is meant:
    --square for --square-size.
    """
    command = _command(error)
    typed = (error.token.keyword or error.token.value).partition("=")[0]
    word, arguments = typed.lstrip("-"), error.argument_collection
    positional = [argument.name for argument in arguments if argument.index is not None]
    if word.upper() in positional:
        return f"unknown option {typed}: {command} {' '.join(positional)} takes {word.upper()} without an option"
    options = {
        name.lstrip("-"): name for argument in arguments if argument.parse for name in argument.names if name[:1] == "-"
    }
    options[HELP] = f"--{HELP}"
    words = {*word.split("-")}
    close = get_close_matches(word, options) or [name for name in options if name in words]
    meant = max(close, key=lambda name: len(words & {*name.split("-")}), default=None)
    advice = f" (did you mean {options[meant]}?)" if meant else f"; {command} --help lists the options"
    return f"unknown option {typed}{advice}"


def _unused_arguments(error: CycloptsError) -> str:
    """Return the message of arguments that the command does not have."""
    command = _command(error)
    unused, typed = error.unused_tokens or [], error.root_input_tokens or []
    before = typed[: typed.index(unused[0])] if unused and unused[0] in typed else []
    arguments = error.app.assemble_argument_collection() if error.app else ()
    option = next((argument for argument in arguments if before[-2:-1] and before[-2] in argument.names), None)
    if option is None:
        names = " ".join(argument.name for argument in arguments if argument.index is not None)
        advice = f"{command} accepts {names or 'only options'}; {command} --help describes them"
    else:
        name, value = before[-2:]
        advice = f"{name} accepts one value"
        if "list[" in str(option.hint) or "tuple[" in str(option.hint):
            advice += f"; for several, repeat it: {name} {value} {name} {unused[0]}"
    return f"unexpected argument {' '.join(unused)}: {advice}"


def _command(error: CycloptsError) -> str:
    """Return the command that does not accept the arguments, as it is typed."""
    return " ".join(("omnisight", *(error.command_chain or ())))

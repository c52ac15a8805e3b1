"""Messages of arguments that a command does not accept."""

from cyclopts import CoercionError, CycloptsError, MissingArgumentError, UnusedCliTokensError


def option_error(error: CycloptsError) -> str:
    """Return the message of an error of the options."""
    message = str(error)
    if isinstance(error, CoercionError) and error.argument is not None and error.argument.parameter.converter:
        message = str(error.__cause__)  # without the name of the option, which the messages of converters contain
    if isinstance(error, UnusedCliTokensError):
        message = _unused_arguments(error)
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        command = " ".join(("omnisight", *(error.command_chain or ())))
        message = f"{error.argument.name} is missing; {command} --help describes it"
        if error.keyword is not None:
            message = f"{error.keyword} needs a value; write {error.keyword}=VALUE if it begins with a dash"
    return message


def _unused_arguments(error: CycloptsError) -> str:
    """Return the message of arguments that the command does not have."""
    command = " ".join(("omnisight", *(error.command_chain or ())))
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

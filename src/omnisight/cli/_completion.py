"""Completion scripts of shells: the names and files that the arguments of commands accept.

cyclopts completes an argument by its type. Names of extensions and most paths are text for it, because the commands
check them with better messages, so their choices and types are set here for the script alone.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cyclopts import App, Parameter
from cyclopts.argument import ArgumentCollection

# Arguments of type text that are files or folders.
FILES = frozenset(("SOURCE", "IMAGES", "CAMERAS", "--images", "--camera", "--output"))


class CompletedApp(App):
    """The program whose arguments have choices and types for the completion."""

    def assemble_argument_collection(self, **options: Any) -> ArgumentCollection:
        """Return the arguments of a command, with the choices and types to complete."""
        arguments = super().assemble_argument_collection(**options)
        known = _choices(self.name[0])
        for argument in arguments:
            if choices := known.get(argument.name):
                argument.parameter = Parameter.combine(argument.parameter, Parameter(choices=choices()))
            elif argument.name in FILES:
                argument.hint = Path
        return arguments

    def generate_completion(self, **options: Any) -> str:
        """Return the script; Bash itself completes files, with a slash after a folder and escaped spaces."""
        script = super().generate_completion(**options)
        script = script.replace('COMPREPLY=( $(compgen -f -- "${cur}") )', "COMPREPLY=()")
        return script.replace("complete -F ", "complete -o bashdefault -o default -F ")


def _choices(command: str) -> dict[str, Callable[[], tuple[str, ...]]]:
    """Return the functions that list the choices of the arguments of a command."""
    from omnisight.formats import format_names
    from omnisight.map_formats import map_format_names
    from omnisight.models import model_names
    from omnisight.optics.design.shapes import KINDS
    from omnisight.optics.models import ray_model_names
    from omnisight.reconstructions import reconstruction_format_names
    from omnisight.simulation import scene_names
    from omnisight.simulation.preset_motion import PRESETS
    from omnisight.targets.boards import board_kinds
    from omnisight.targets.boards._aruco import dictionary_names
    from omnisight.targets.printing.paper import PAPERS

    choices: dict[str, dict[str, Callable[[], tuple[str, ...]]]] = {
        "calibrate": {"--model": lambda: ("auto", *model_names(), *ray_model_names())},
        "calibrate-rig": {"--model": lambda: ("auto", *model_names())},
        "calibrate-lines": {"--model": model_names},
        "convert": {"--to": format_names, "--model": model_names},
        "design": {"--kind": lambda: tuple(KINDS)},
        "export": {"--to": lambda: (*map_format_names(), *reconstruction_format_names(), "viewer")},
        "simulate": {"SCENE": scene_names, "--trajectory": lambda: PRESETS},
        "target": {"KIND": board_kinds, "--paper": lambda: tuple(PAPERS), "--dictionary": dictionary_names},
    }
    return choices.get(command, {})

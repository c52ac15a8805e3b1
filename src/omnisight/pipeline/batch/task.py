"""What a batch does with each item of its work."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import omnisight


@dataclass(frozen=True)
class Item:
    """Files that are processed together: one image, or the simultaneous images of several cameras.

    Attributes
    ----------
    inputs
        Paths in the file system of the source.
    outputs
        Names of the files that are written, below the output folder.
    group
        Which of several cameras or plans of a task applies.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    group: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """The inputs without their folders, for messages."""
        return tuple(path.rsplit("/", 1)[-1] for path in self.inputs)


# From an item and the bytes of its inputs to those of its outputs; raises `ValueError` if an input cannot be used.
Process = Callable[[Item, Sequence[bytes]], Sequence[bytes]]


class Task(Protocol):
    """Work on one item at a time, with a result that depends on nothing but the item, its bytes and `description`."""

    @property
    def description(self) -> dict[str, Any]:
        """What determines the result, as JSON: a run continues only with an equal description."""
        ...

    def prepare(self) -> Process:
        """Return the function that processes an item, once for each worker."""
        ...


def describe(command: str, *, options: Any, **parts: str) -> dict[str, Any]:
    """Return the description of a task: the command, the version, the options that are set, and other parts."""
    chosen = {name: value for name, value in asdict(options).items() if value not in (None, ())}
    version = omnisight.__version__
    return {"command": command, "version": version, **parts, "options": json.loads(json.dumps(chosen, default=str))}

"""What a batch does with each item of its work."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, is_dataclass
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
    version
        Differs if an input has changed; not part of the identity of an item.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    group: int = 0
    version: str = field(default="", compare=False)

    @property
    def name(self) -> str:
        """The first input, which no other item of a batch has."""
        return self.inputs[0]

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


def describe(command: str, **parts: Any) -> dict[str, Any]:
    """Return the description of a task: the command, the version, and its parts, of options those that are set."""
    values = {name: _set_options(part) if is_dataclass(part) else part for name, part in parts.items()}
    return json.loads(json.dumps({"command": command, "version": omnisight.__version__, **values}, default=str))


def _set_options(options: Any) -> dict[str, Any]:
    return {name: value for name, value in asdict(options).items() if value not in (None, ())}

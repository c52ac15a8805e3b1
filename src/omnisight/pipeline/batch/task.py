"""What a batch does with each file."""

from collections.abc import Callable
from typing import Any, Protocol


class Task(Protocol):
    """Work on one file at a time, with a result that depends on nothing but its bytes and `description`."""

    @property
    def description(self) -> dict[str, Any]:
        """What determines the result, as JSON: a run continues only with an equal description."""
        ...

    @property
    def suffix(self) -> str:
        """Suffix of the output files."""
        ...

    def prepare(self) -> Callable[[bytes, str], bytes]:
        """Return the function from the bytes and the name of a file to its output, once for each worker.

        The function raises `ValueError` for a file that cannot be used.
        """
        ...

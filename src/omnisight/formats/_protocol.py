"""What a calibration format gives."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from omnisight.camera import Camera


class FormatError(ValueError):
    """A calibration file that cannot be read or written: says which, what was found and what to do."""


@dataclass(frozen=True)
class Written:
    """What was written, and how well it reads back.

    Attributes
    ----------
    path
        The file.
    error_px
        The largest difference (px), over the image, between the camera and the file read again.
    notes
        What the format cannot hold, a sentence each.
    """

    path: Path
    error_px: float
    notes: tuple[str, ...] = field(default=())


class Format(Protocol):
    """One calibration format: a module of this folder with these names."""

    TITLE: str
    """What it is called in full."""
    SUFFIX: str
    """The file ending to suggest."""
    MODELS: tuple[str, ...]
    """The camera models that it holds exactly, the most usual first."""
    CONVENTION: str
    """Its frame, pixel origin and order of numbers, in one line."""

    def matches(self, text: str) -> bool:
        """Say whether the text of a file looks like this format."""
        ...

    def parse(self, text: str) -> Mapping[str, Camera]:
        """Read every camera of a file, by name.

        Raises
        ------
        ValueError
            What is wrong, with the value found; the caller adds the file's name.
        """
        ...

    def render(self, camera: Camera) -> tuple[str, tuple[str, ...]]:
        """Give the text of a file that holds the camera, and what it could not hold, a sentence each.

        Raises
        ------
        ValueError
            If the format has no such model.
        """
        ...


def note_unknown(values: Mapping[str, Any], known: set[str]) -> dict[str, Any]:
    """Give what a file holds beside the known keys, to be kept as a camera's `extra`."""
    return {key: value for key, value in values.items() if key not in known}

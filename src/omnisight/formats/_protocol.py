"""The protocol of a calibration format."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats._readers import Reader
from omnisight.rig import Rig


class FormatError(ValueError):
    """A file that cannot be read or written; the message names the file, the value and what to do."""


@dataclass(frozen=True)
class SaveResult(Displayed):
    """A calibration file that was written, and how accurately it reads back.

    Attributes
    ----------
    path
        The file.
    error_px
        The largest difference (px) over the image between the camera and the file that was written.
    notes
        What the format cannot hold, and where its reader stops or errs, one sentence each.
    rotation_deg, translation
        Of a rig: the largest differences of its poses relative to the first camera, degrees and the unit of the rig.
    """

    path: Path
    error_px: float
    notes: tuple[str, ...] = field(default=())
    rotation_deg: float = 0.0
    translation: float = 0.0


class Format(Protocol):
    """A calibration format: a module of this folder with these names.

    Attributes
    ----------
    TITLE
        The full name.
    SUFFIX
        The usual file ending.
    CONVENTION
        The frame, pixel origin and order of numbers, in one line.
    MODELS
        The camera models that the format holds exactly, the most usual first.
    COMMENT
        A comment line with {} for its text; empty if the format has no comments.
    READERS
        The program that usually reads each model, and its limit as measured; without an entry it was not measured.
    """

    TITLE: str
    SUFFIX: str
    CONVENTION: str
    MODELS: tuple[str, ...]
    COMMENT: str
    READERS: Mapping[str, Reader]

    def matches(self, text: str) -> bool:
        """Return whether the text of a file is in this format."""
        ...

    def parse(self, text: str) -> Mapping[str, Camera]:
        """Return the cameras of a file by name.

        Raises
        ------
        ValueError
            If the file is damaged; the message has the value, the caller adds the file name.
        """
        ...

    def serialize(self, camera: Camera) -> tuple[str, tuple[str, ...]]:
        """Return the text of a file that holds the camera, and what it does not hold, one sentence each.

        Raises
        ------
        ValueError
            If the format cannot hold the camera.
        """
        ...


class RigFormat(Format, Protocol):
    """A calibration format that also holds the poses of several cameras: a module that has these functions too."""

    def parse_rig(self, text: str) -> Rig:
        """Return the rig of a file.

        Raises
        ------
        ValueError
            If the file is damaged, or its cameras have no poses.
        """
        ...

    def serialize_rig(self, rig: Rig) -> tuple[str, tuple[str, ...]]:
        """Return the text of a file that holds the rig, and what it does not hold, one sentence each.

        Raises
        ------
        ValueError
            If the format cannot hold the rig.
        """
        ...

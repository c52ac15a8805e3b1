"""The protocol of a format of reconstructions."""

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from omnisight.sfm.reconstruction import Reconstruction

# The path of a file relative to the output folder, with "/", and its content.
OutputFile = tuple[str, bytes]


class ReconstructionError(ValueError):
    """A reconstruction that cannot be read or written; the message names the file, the value and what to do."""


class ReconstructionFormat(Protocol):
    """A format of reconstructions: a module of this folder with these names.

    Attributes
    ----------
    TITLE
        The full name.
    CONVENTION
        The frames, pixel origin and order of numbers, in one line.
    """

    TITLE: str
    CONVENTION: str

    def files(self, reconstruction: Reconstruction, images: Path | None) -> Iterable[OutputFile]:
        """Return the files that hold a reconstruction, in the order in which they are to be written.

        Parameters
        ----------
        reconstruction
            The reconstruction.
        images
            The folder of its images, or None if it is not known.

        Raises
        ------
        ValueError
            If the format cannot hold the reconstruction, or needs the images. Raised before the first file.
        """
        ...

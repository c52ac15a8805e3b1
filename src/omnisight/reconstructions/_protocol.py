"""The protocol of a format of reconstructions."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from omnisight.choices import Options
from omnisight.sfm.reconstruction import Reconstruction

# The path of a file relative to the output folder, with "/", and its content.
OutputFile = tuple[str, bytes]


@dataclass(frozen=True)
class ExportOptions(Options):
    """Options of `export`.

    Attributes
    ----------
    format
        The format to write, one of `omnisight.reconstructions.reconstruction_format_names()`.
    images
        The folder of the images, to which their names are relative; `splat` needs it.
    size
        The width of a view of 90 degrees (px) that `splat` writes; by default the resolution of the image is kept.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    format: str = "colmap"
    images: Path | None = None
    size: int | None = None
    apply_exif: bool = False


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

    def files(self, reconstruction: Reconstruction, options: ExportOptions) -> Iterable[OutputFile]:
        """Return the files that hold a reconstruction, in the order in which they are to be written.

        Parameters
        ----------
        reconstruction
            The reconstruction.
        options
            The folder of the images, and the size of views.

        Raises
        ------
        ValueError
            If the format cannot hold the reconstruction, or needs the images. Raised before the first file.
        """
        ...

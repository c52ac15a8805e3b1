"""Options of `convert`; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path

from omnisight.choices import Options


@dataclass(frozen=True)
class ConvertOptions(Options):
    """Options of `convert`.

    Attributes
    ----------
    format
        The format to write, one of `omnisight.formats.format_names()`.
    model
        The camera model to convert to. By default the camera's own if the format holds it, otherwise the most accurate
        model of the format.
    output
        The file to write; by default in the folder of the input.
    name
        The camera to convert if the file holds several; by default the rig of all of them.
    distance
        The distance of the scene from a non-central camera, with its unit (2m, 20squares, or inf). The central camera
        that fits there is written.
    max_theta_deg
        Fit only up to this angle from the axis, degrees, instead of the calibrated field of view.
    max_error_px
        The largest error with which a file is written, px.
    force
        Write the file whatever its error.
    invert_extrinsics
        Of a rig: use the inverse of the poses in the file; `inspect --images` checks them.
    flip
        Exchange left and right of the camera frame: a camera that looks into one mirror, if it was calibrated with
        boards without markers, and is used together with other cameras. Its views then need no --flip.
    """

    format: str = "native"
    model: str | None = None
    output: Path | None = None
    name: str | None = None
    distance: str | None = None
    max_theta_deg: float | None = None
    max_error_px: float = 1.0
    force: bool = False
    invert_extrinsics: bool = False
    flip: bool = False

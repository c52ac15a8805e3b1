"""Calibration of a camera from images of straight lines: the counterpart of `omnisight calibrate-lines`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from omnisight.calibration.lines.estimation import LineEstimationOptions, estimate_camera, estimate_unified_camera
from omnisight.calibration.lines.observations import LineObservations, detect_lines, read_drawn_lines
from omnisight.calibration.lines.result import LinesCalibration
from omnisight.images import collect_images
from omnisight.pipeline.calibration.provenance import tool_provenance
from omnisight.progress import Progress, no_progress

Source = LineObservations | str | PathLike[str] | Sequence[str | PathLike[str]]


@dataclass(frozen=True)
class CalibrateLinesOptions(LineEstimationOptions):
    """Options of `calibrate_lines`; see also `LineEstimationOptions`.

    Attributes
    ----------
    mask
        Image that is white where lines are searched; by default the image field is estimated.
    lines
        File of lines drawn by the user, which replace the detected arcs; see `read_polylines`.
    apply_exif
        Whether to rotate images by their EXIF orientation; a calibration needs them as the sensor recorded them.
    """

    mask: Path | None = None
    lines: Path | None = None
    apply_exif: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mask is not None and self.lines is not None:
            raise ValueError("--mask is for the detection of edges, which --lines replaces: specify one of them")


def calibrate_lines(
    source: Source, options: CalibrateLinesOptions = CalibrateLinesOptions(), *, progress: Progress = no_progress
) -> LinesCalibration:
    """Calibrate a camera from images of straight lines.

    Arcs that one camera cannot explain together as images of lines are rejected. Lines do not determine the handedness
    of the camera, nor the focal scale of models with a free radial profile.

    Parameters
    ----------
    source
        A folder, image files or glob patterns, all of one camera; or `LineObservations`.
    options
        Options of the command.
    progress
        Called with the stage, the work done and the total.

    Raises
    ------
    ValueError
        If an input cannot be read, or the lines do not determine the camera.
    """
    observations = load_line_observations(source, options, progress=progress)
    unique, kept, duplicate_of = observations.without_static_duplicates()
    estimate = estimate_unified_camera(unique, options, partial(progress, "unified"))
    if options.model != "unified":
        estimate = estimate_camera(estimate, unique, options, partial(progress, options.model))
    line_of_arc = np.full(len(observations.arcs), -1, np.intp)
    line_of_arc[kept] = estimate.consensus.line_of_arc
    is_duplicate = duplicate_of >= 0
    line_of_arc[is_duplicate] = line_of_arc[duplicate_of[is_duplicate]]
    provenance: dict[str, Any] = {**tool_provenance(), "images": list(observations.image_names)}
    if options.lines is not None:
        provenance["lines"] = options.lines.name
    return LinesCalibration.from_estimate(
        estimate, observations, line_of_arc, is_xi_fixed="xi" in options.fixed, provenance=provenance
    )


def load_line_observations(
    source: Source, options: CalibrateLinesOptions, *, progress: Progress = no_progress
) -> LineObservations:
    """Detect the arcs of the images, or read the drawn lines.

    Raises
    ------
    ValueError
        If the source is empty or of another type, or a file cannot be read.
    """
    if isinstance(source, LineObservations):
        return source
    items: list[object] = [source] if isinstance(source, str | PathLike) else list(source)
    if not all(isinstance(item, str | PathLike) for item in items):
        raise ValueError(
            "source must be a folder, image files, glob patterns or LineObservations, got"
            f" {type(source).__name__}; for arrays use LineObservations(PixelChains.from_arrays(lines), size)"
        )
    paths = collect_images([str(item) for item in items])
    if options.lines is not None:
        return read_drawn_lines(paths, options.lines, apply_exif=options.apply_exif)
    return detect_lines(paths, mask=options.mask, apply_exif=options.apply_exif, progress=progress)

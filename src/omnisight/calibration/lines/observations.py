"""Observations of lines: detected arcs of images, or lines drawn by the user."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.lines.arc_detection import deduplicate_static_arcs, detect_arcs
from omnisight.calibration.lines.pixel_chains import PixelChains
from omnisight.calibration.lines.polyline_file import read_polylines
from omnisight.display import Displayed
from omnisight.images import estimate_image_field, read_image, read_mask, to_gray8
from omnisight.images.output_paths import image_labels
from omnisight.progress import Progress, no_progress

Array = NDArray[np.float64]

MAX_LISTED_LABELS = 5  # in an error message


@dataclass(frozen=True)
class LineObservations(Displayed):
    """Arcs in the images of one camera.

    Attributes
    ----------
    arcs
        Pixels along edges, or along lines drawn by the user.
    size
        (width, height) of the images, px.
    border_centre
        (2,) centre of the border of the lens or mirror, a measurement of the principal point; None if not visible.
    all_inliers
        Whether every arc is the image of a line, as for drawn lines: none is rejected, none joined.
    image_names
        Names of the images, in the order of `arcs.image_ids`.
    """

    arcs: PixelChains
    size: tuple[int, int]
    border_centre: Array | None = None
    all_inliers: bool = False
    image_names: tuple[str, ...] = ()

    @property
    def expected_centre(self) -> Array:
        """(2,) expected principal point: the border's centre, else the centre of the image."""
        return (np.array(self.size, float) - 1) / 2 if self.border_centre is None else self.border_centre

    def without_static_duplicates(self) -> tuple["LineObservations", NDArray[np.intp], NDArray[np.intp]]:
        """Remove repeated static edges; return the rest, its arc indices (K,), and `duplicate_of` of all arcs (A,)."""
        count = len(self.arcs)
        duplicate_of = np.full(count, -1, np.intp) if self.all_inliers else deduplicate_static_arcs(self.arcs)
        kept = np.flatnonzero(duplicate_of < 0)
        return replace(self, arcs=self.arcs.subset(kept)), kept, duplicate_of


def detect_lines(
    paths: Sequence[Path], *, mask: Path | None = None, apply_exif: bool = False, progress: Progress = no_progress
) -> LineObservations:
    """Detect the arcs of images.

    Parameters
    ----------
    paths
        Image files of one camera.
    mask
        Image that is white where lines are searched; in a bitmap (PBM), 1. By default the image field is estimated.
    apply_exif
        Whether to rotate images by their EXIF orientation.
    progress
        Called with the stage, the number of images done and their total.

    Raises
    ------
    ValueError
        If an image cannot be read, the sizes differ or the mask does not fit.
    """
    size = _common_size(paths, apply_exif)
    field = estimate_image_field(to_gray8(read_image(path, apply_exif=apply_exif)) for path in paths)
    allowed = None if mask is None else _read_mask(mask, size)
    arcs: list[Array] = []
    image_ids: list[int] = []
    for i, path in enumerate(paths):
        progress("detect arcs", i, len(paths))
        detected = detect_arcs(to_gray8(read_image(path, apply_exif=apply_exif)), field, allowed)
        arcs += detected
        image_ids += [i] * len(detected)
    progress("detect arcs", len(paths), len(paths))
    centre = None if field.outer is None else np.array(field.outer.centre)
    return LineObservations(PixelChains.from_arrays(arcs, image_ids), size, centre, False, tuple(image_labels(paths)))


def read_drawn_lines(paths: Sequence[Path], file: Path, *, apply_exif: bool = False) -> LineObservations:
    """Read the lines that a user drew in images; see `read_polylines` for the file.

    Raises
    ------
    ValueError
        If a file cannot be read, the image sizes differ, or the lines name an unknown image.
    """
    size = _common_size(paths, apply_exif)
    labels = image_labels(paths)
    index = {label: i for i, label in enumerate(labels)} | {"": 0}
    lines_of_image = read_polylines(file)
    if unknown := sorted(set(lines_of_image) - set(index)):
        same = [label for label, path in zip(labels, paths, strict=True) if path.name == unknown[0]]
        raise ValueError(
            f"{file}: names {unknown[0]}, which several images are named: use {', '.join(same[:MAX_LISTED_LABELS])}"
            if same
            else f"{file}: names {unknown[0]}, which is not one of the images ({labels[0]} ...)"
        )
    lines = [(line, index[name]) for name, part in lines_of_image.items() for line in part]
    chains = PixelChains.from_arrays([line for line, _ in lines], [i for _, i in lines])
    return LineObservations(chains, size, None, True, tuple(labels))


def _common_size(paths: Sequence[Path], apply_exif: bool) -> tuple[int, int]:
    """Return the size (width, height) of all images, or raise `ValueError` if they differ."""
    sizes = [read_image(path, apply_exif=apply_exif).shape[1::-1] for path in paths]
    for path, size in zip(paths, sizes, strict=True):
        if size != sizes[0]:
            raise ValueError(
                f"{path}: is {size[0]} x {size[1]} px and {paths[0].name} is {sizes[0][0]} x {sizes[0][1]} px: images"
                " of one camera have one size"
            )
    return sizes[0][0], sizes[0][1]


def _read_mask(path: Path, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Read the mask (H, W) of the pixels where lines are searched."""
    allowed = read_mask(path, size)
    if not allowed.any():
        raise ValueError(f"{path}: the mask allows no pixel; paint the areas where lines are searched white")
    return allowed

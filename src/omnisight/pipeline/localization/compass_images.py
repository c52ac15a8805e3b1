"""Panoramas for the visual compass: reading, unwrapping, and reduction to a working size."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.rotation import look
from omnisight.images import collect_images, expand_path, read_image, to_gray8
from omnisight.pipeline.inputs.central_camera import CameraSource, camera_of_image, central_camera
from omnisight.pipeline.localization.compass_options import CompassOptions
from omnisight.places.panorama_signature import PanoramaSignature
from omnisight.views import Remapper, sphere
from omnisight.views.image_size import is_resized
from omnisight.views.maps import extrapolation_mask

CompassImage = str | PathLike[str] | NDArray[Any]

# One column per degree: sub-column precision is far below a degree.
MAX_COLUMNS = 360
# Fewer columns do not resolve the harmonics of rotation and translation with residuals left for their uncertainty.
MIN_COLUMNS = 8
# An unwrapped panorama that covers 360 degrees is at least as wide as an equirectangular image of the whole sphere.
MIN_ASPECT = 2.0


@dataclass(frozen=True, eq=False)
class NamedImage:
    """An image, or the file of one, and its name in messages."""

    name: str
    source: Path | NDArray[Any]


def named_images(images: CompassImage | Sequence[CompassImage]) -> list[NamedImage]:
    """List images: those of folders, files and patterns, and arrays, in the order in which they are specified.

    Raises
    ------
    ValueError
        If there is none, or a file does not exist.
    """
    if isinstance(images, str | PathLike | np.ndarray):
        images = [images]
    arrays = [each for each in images if isinstance(each, np.ndarray)]
    paths = [str(each) for each in images if not isinstance(each, np.ndarray)]
    if arrays and paths:
        raise ValueError("images are files and arrays: specify either files or arrays")
    if arrays:
        return [NamedImage(f"image {i + 1}", each) for i, each in enumerate(arrays)]
    # The order is that of the arguments, and natural in a folder.
    rank = {file: k for k, path in reversed([*enumerate(paths)]) for file in expand_path(path)}
    return [NamedImage(file.name, file) for file in sorted(collect_images(paths), key=rank.__getitem__)]


class PanoramaReader:
    """Reads images as signatures of panoramas of one size.

    Parameters
    ----------
    camera
        The camera of the images or its file; None for unwrapped and equirectangular panoramas.
    options
        Options of the command.

    Raises
    ------
    ValueError
        If the camera file cannot be read, or the camera is not central.
    """

    def __init__(self, camera: CameraSource | None, options: CompassOptions) -> None:
        if camera is None and (options.up or options.name or options.scale_camera):
            raise ValueError("--up, --name and --scale-camera are those of a camera: specify its file (--camera)")
        if not (camera is None or isinstance(camera, Camera)):
            camera = central_camera(camera, name=options.name, accepts_distance=False)
        self._camera, self._options = camera, options
        self._size: tuple[int, int] | None = None
        self._unwrap = dict[tuple[int, int], tuple[Remapper, slice, NDArray[np.float64]]]()

    def __call__(self, image: NamedImage) -> PanoramaSignature:
        """Return the signature of an image.

        Raises
        ------
        ValueError
            If it cannot be read, is no panorama, has another shape than the first one, or is uniform.
        """
        pixels = image.source
        if isinstance(pixels, Path):
            pixels = read_image(pixels, apply_exif=self._options.apply_exif)
        gray, weights = to_gray8(pixels), None
        size = gray.shape[1], gray.shape[0]
        if self._camera is not None:
            if size not in self._unwrap:
                self._unwrap[size] = self._unwrapping(size, image.name)
            remapper, rows, weights = self._unwrap[size]
            gray = remapper(gray)[rows]
        else:
            gray = self._reduced(gray, image.name)
            if size[0] == 2 * size[1]:
                weights = _cosines(gray.shape[0])
        signature = PanoramaSignature(gray, weights)
        if signature.is_uniform:
            raise ValueError(f"{image.name}: is uniform along its rows and shows no heading")
        return signature

    def _reduced(self, gray: NDArray[np.uint8], name: str) -> NDArray[Any]:
        """Return a panorama in the working size, that of the first one and at most MAX_COLUMNS wide."""
        import cv2

        height, width = gray.shape
        if width < MIN_ASPECT * height:
            raise ValueError(
                f"{name}: is {width}x{height} px, and a panorama of 360° is at least {MIN_ASPECT:g} times as wide as"
                " high: specify the camera of raw images (--camera)"
            )
        if width < MIN_COLUMNS:
            raise ValueError(f"{name}: is {width} px wide; a panorama needs at least {MIN_COLUMNS} columns")
        self._size = self._size or (width, height)
        if not is_resized((width, height), self._size):
            raise ValueError(
                f"{name}: is {width}x{height} px, the first panorama {self._size[0]}x{self._size[1]}: panoramas of"
                " different shape do not show the same elevations"
            )
        columns = min(self._size[0], MAX_COLUMNS)
        rows = max(1, round(self._size[1] * columns / self._size[0]))
        if (width, height) == (columns, rows):
            return gray
        interpolation = cv2.INTER_AREA if width > columns else cv2.INTER_LINEAR
        return cv2.resize(gray.astype(np.float32), (columns, rows), interpolation=interpolation)

    def _unwrapping(self, size: tuple[int, int], name: str) -> tuple[Remapper, slice, NDArray[np.float64]]:
        """Return the map to a panorama, its rows that the camera sees all around, and their weights."""
        options = self._options
        camera = camera_of_image(self._camera, size, name, name=None, scale=options.scale_camera)
        up = options.up or ("back" if camera.theta_min > 0 else "top")
        view, rotation = sphere(min(MAX_COLUMNS, size[0])), look(up=up)
        remapper = Remapper(camera, view, rotation)
        seen = (remapper.mask & ~extrapolation_mask(camera, view, rotation)).all(axis=1)
        rows = np.flatnonzero(seen)
        if not len(rows):
            raise ValueError(
                f"{name}: the camera does not see 360° around the vertical, which is {up!r}: specify --up back for a"
                " camera that looks down or into a mirror above it, --up front for one that looks up"
            )
        weights = _cosines(view.height)
        return remapper, slice(rows[0], rows[-1] + 1), weights[rows[0] : rows[-1] + 1]


def _cosines(rows: int) -> NDArray[np.float64]:
    """Return the cosines of the elevations of the rows of a sphere: the relative solid angles of their pixels."""
    return np.cos(np.pi * ((np.arange(rows) + 0.5) / rows - 0.5))

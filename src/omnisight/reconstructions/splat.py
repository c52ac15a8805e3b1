"""Perspective views of every image with masks, and their poses as a COLMAP rig, for 3D Gaussian splatting.

The folder has `images`, `masks` and `sparse/0`, as the programs for Gaussian splatting and COLMAP expect them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images import ImageField, encode_image, estimate_image_field, read_image, to_gray8
from omnisight.reconstructions._colmap_model import colmap_model
from omnisight.reconstructions._perspective_views import PerspectiveView, in_perspective_views, perspective_views
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.reconstructions.colmap_binary import colmap_binary_files
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "perspective views for Gaussian splatting"
CONVENTION = (
    "images/NAME_FACE.jpg, masks/NAME_FACE.jpg.png (black is not used), and in sparse/0 COLMAP binary with the views as"
    " a rig"
)
IMAGE_FOLDER, MASK_FOLDER, MODEL_FOLDER = "images", "masks", "sparse/0"
IN_IMAGE_FOLDER = "is the folder of the images, and views in it would be read as images: choose another output"
NUM_FIELD_IMAGES = 8  # in whose maximum the image circle is detected
MIN_SIZE_PX, MAX_SIZE_PX = 16, 16384


@dataclass(frozen=True, eq=False)
class CameraViews:
    """What determines the views of the images of a camera.

    Attributes
    ----------
    camera
        The camera.
    field
        Its image circle, if it has no calibrated field of view.
    size
        Width of a view of 90 degrees, px; None for the resolution of the image.
    """

    camera: Camera
    field: ImageField | None
    size: int | None

    def views(self) -> list[PerspectiveView]:
        """Return the views, with their maps."""
        return perspective_views(self.camera, self.field, self.size)

    def renderer(self) -> Callable[[NDArray[Any], str, Sequence[str]], list[bytes]]:
        """Return the function from an image, its name and those of its views to the files of views and masks."""
        views = self.views()
        masks = [encode_image(np.where(view.mask, 255, 0).astype(np.uint8), "mask.png") for view in views]

        def render(image: NDArray[Any], label: str, names: Sequence[str]) -> list[bytes]:
            content = _to_8_bit(image, label)
            pairs = zip(views, masks, names, strict=True)
            return [data for view, mask, name in pairs for data in (encode_image(view.remapper(content), name), mask)]

        return render


@dataclass(frozen=True, eq=False)
class SplatExport:
    """An export before its images are read.

    Attributes
    ----------
    cameras
        Views of each camera; None for one without images.
    names
        Names of the views of each image.
    model
        Files of the model.
    """

    cameras: tuple[CameraViews | None, ...]
    names: list[list[str]]
    model: list[OutputFile]

    def outputs(self, image: int) -> list[str]:
        """Return the paths of the views and masks of an image."""
        names = self.names[image]
        return [path for name in names for path in (f"{IMAGE_FOLDER}/{name}", f"{MASK_FOLDER}/{name}.png")]


def files(reconstruction: Reconstruction, options: ExportOptions) -> Iterator[OutputFile]:
    """Return the views one by one, then the model: a folder without it is incomplete."""
    paths = _image_paths(reconstruction, options)

    def read(image: int) -> NDArray[Any]:
        return read_image(paths[image], apply_exif=options.apply_exif)

    return _files(reconstruction, paths, plan_splat(reconstruction, options.size, read), read)


def plan_splat(reconstruction: Reconstruction, size: int | None, read: Callable[[int], NDArray[Any]]) -> SplatExport:
    """Return the views of all images and their model; `read` returns an image.

    Raises
    ------
    ValueError
        If the size is not usable, or a camera has no views.
    """
    if size is not None and not MIN_SIZE_PX <= size <= MAX_SIZE_PX:
        raise ValueError(f"--size must be from {MIN_SIZE_PX} to {MAX_SIZE_PX} px, got {size}")
    cameras = tuple(_camera_views(reconstruction, sensor, size, read) for sensor in range(len(reconstruction.rig)))
    views = [_views(reconstruction, sensor, each) for sensor, each in enumerate(cameras)]
    names = [
        [f"{stem}_{view.name}.jpg" for view in views[sensor]]
        for stem, sensor in zip(_flat_names(reconstruction.names), reconstruction.sensor.tolist(), strict=True)
    ]
    model = colmap_binary_files(colmap_model(in_perspective_views(reconstruction, views, names)))
    return SplatExport(cameras, names, [(f"{MODEL_FOLDER}/{name}", data) for name, data in model])


def _files(
    reconstruction: Reconstruction, paths: Sequence[Path], export: SplatExport, read: Callable[[int], NDArray[Any]]
) -> Iterator[OutputFile]:
    """Yield the views and masks of all images, and the model."""
    renderers = [None if each is None else each.renderer() for each in export.cameras]
    for image, path in enumerate(paths):
        if (render := renderers[int(reconstruction.sensor[image])]) is not None:
            yield from zip(export.outputs(image), render(read(image), str(path), export.names[image]), strict=True)
    yield from export.model


def _image_paths(reconstruction: Reconstruction, options: ExportOptions) -> list[Path]:
    """Return the path of each image; raise ValueError if one is missing."""
    if options.images is None:
        raise ValueError("needs the folder of the images, to which their names are relative: --images FOLDER")
    paths = [options.images / PurePosixPath(name) for name in reconstruction.names]
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise ValueError(
            f"{missing[0]}: no such file or folder; {len(missing)} of {len(paths)} images are not in {options.images}:"
            " specify the folder that was reconstructed with --images"
        )
    return paths


def _camera_views(
    reconstruction: Reconstruction, sensor: int, size: int | None, read: Callable[[int], NDArray[Any]]
) -> CameraViews | None:
    """Return what determines the views of a camera: without a calibrated field of view also its image circle."""
    camera, name = reconstruction.rig.cameras[sensor], reconstruction.rig.names[sensor]
    if not isinstance(camera, Camera):
        raise ValueError(
            f"camera {name} is non-central ({camera.model.name}), and a view needs one viewpoint: reconstruct with the"
            " central camera that fits (omnisight convert --distance)"
        )
    own = np.flatnonzero(reconstruction.sensor == sensor).tolist()
    if not own:
        return None
    field: ImageField | None = None
    if camera.theta_max is None and camera.model.period is None:
        step = max(1, len(own) // NUM_FIELD_IMAGES)
        field = estimate_image_field(to_gray8(read(image)) for image in own[::step][:NUM_FIELD_IMAGES])
    return CameraViews(camera, field, size)


def _views(reconstruction: Reconstruction, sensor: int, camera: CameraViews | None) -> list[PerspectiveView]:
    """Return the views of a camera; messages start with its name."""
    try:
        return [] if camera is None else camera.views()
    except ValueError as error:
        raise ValueError(f"camera {reconstruction.rig.names[sensor]}: {error}") from error


def _to_8_bit(image: NDArray[Any], label: str) -> NDArray[Any]:
    """Return an image (H, W) or (H, W, 3) of uint8: JPEG has 8 bits and no transparency."""
    image = image[:, :, :3] if image.ndim == 3 else image
    if image.dtype.name not in ("uint8", "uint16"):
        raise ValueError(f"{label}: is {image.dtype}; convert it to 8 or 16 bits per channel")
    return image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)


def _flat_names(names: Sequence[str]) -> list[str]:
    """Return unique names without folders and suffixes: some programs read only the last part of a path."""
    flat = [str(PurePosixPath(name).with_suffix("")).replace("/", "_") for name in names]
    if len({name.casefold() for name in flat}) == len(flat):
        return flat
    return [f"{i:0{len(str(len(names)))}}_{name}" for i, name in enumerate(flat)]

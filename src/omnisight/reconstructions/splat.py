"""Perspective views of every image with masks, and their poses as a COLMAP rig, for 3D Gaussian splatting.

The folder has `images`, `masks` and `sparse/0`, as the programs for Gaussian splatting and COLMAP expect them.
"""

from collections.abc import Iterator, Sequence
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
NUM_FIELD_IMAGES = 8  # in whose maximum the image circle is detected
MIN_SIZE_PX, MAX_SIZE_PX = 16, 16384


def files(reconstruction: Reconstruction, options: ExportOptions) -> Iterator[OutputFile]:
    """Return the views one by one, then the model: a folder without it is incomplete."""
    paths = _image_paths(reconstruction, options)
    if options.size is not None and not MIN_SIZE_PX <= options.size <= MAX_SIZE_PX:
        raise ValueError(f"--size must be from {MIN_SIZE_PX} to {MAX_SIZE_PX} px, got {options.size}")
    views = [_views(reconstruction, sensor, paths, options.size) for sensor in range(len(reconstruction.rig))]
    stems = _flat_names(reconstruction.names)
    names = [
        [f"{stem}_{view.name}.jpg" for view in views[sensor]]
        for stem, sensor in zip(stems, reconstruction.sensor.tolist(), strict=True)
    ]
    model = colmap_model(in_perspective_views(reconstruction, views, names))
    return _files(reconstruction, paths, views, names, colmap_binary_files(model))


def _files(
    reconstruction: Reconstruction,
    paths: Sequence[Path],
    views: Sequence[Sequence[PerspectiveView]],
    names: Sequence[Sequence[str]],
    model: Sequence[OutputFile],
) -> Iterator[OutputFile]:
    """Yield the views and masks of all images, and the model."""
    masks = [[encode_image(np.where(v.mask, 255, 0).astype(np.uint8), "mask.png") for v in own] for own in views]
    for image, path in enumerate(paths):
        content, sensor = _read_8_bit(path), int(reconstruction.sensor[image])
        for name, view, mask in zip(names[image], views[sensor], masks[sensor], strict=True):
            yield f"{IMAGE_FOLDER}/{name}", encode_image(view.remapper(content), name)
            yield f"{MASK_FOLDER}/{name}.png", mask
    for name, data in model:
        yield f"{MODEL_FOLDER}/{name}", data


def _image_paths(reconstruction: Reconstruction, options: ExportOptions) -> list[Path]:
    """Return the path of each image; raise ValueError if one is missing."""
    if options.images is None:
        raise ValueError("needs the folder of the images, to which their names are relative: --images FOLDER")
    paths = [options.images / PurePosixPath(name) for name in reconstruction.names]
    missing = [path for path in paths if not path.is_file()]
    if missing:
        raise ValueError(
            f"{missing[0]}: no such file; {len(missing)} of {len(paths)} images are not in {options.images}: specify"
            " the folder that was reconstructed with --images"
        )
    return paths


def _views(
    reconstruction: Reconstruction, sensor: int, paths: Sequence[Path], size: int | None
) -> list[PerspectiveView]:
    """Return the views of a camera; without a calibrated field of view their masks are those of its image circle."""
    camera, name = reconstruction.rig.cameras[sensor], reconstruction.rig.names[sensor]
    if not isinstance(camera, Camera):
        raise ValueError(
            f"camera {name} is non-central ({camera.model.name}), and a view needs one viewpoint: reconstruct with the"
            " central camera that fits (omnisight convert --distance)"
        )
    own = [paths[image] for image in np.flatnonzero(reconstruction.sensor == sensor).tolist()]
    if not own:
        return []
    field: ImageField | None = None
    if camera.theta_max is None and camera.model.period is None:
        step = max(1, len(own) // NUM_FIELD_IMAGES)
        field = estimate_image_field(to_gray8(read_image(path)) for path in own[::step][:NUM_FIELD_IMAGES])
    try:
        return perspective_views(camera, field, size)
    except ValueError as error:
        raise ValueError(f"camera {name}: {error}") from error


def _read_8_bit(path: Path) -> NDArray[Any]:
    """Return an image (H, W) or (H, W, 3) of uint8: JPEG has 8 bits and no transparency."""
    image = read_image(path)
    image = image[:, :, :3] if image.ndim == 3 else image
    if image.dtype.name not in ("uint8", "uint16"):
        raise ValueError(f"{path}: is {image.dtype}; convert it to 8 or 16 bits per channel")
    return image if image.dtype == np.uint8 else (image >> 8).astype(np.uint8)


def _flat_names(names: Sequence[str]) -> list[str]:
    """Return unique names without folders and suffixes: some programs read only the last part of a path."""
    flat = [str(PurePosixPath(name).with_suffix("")).replace("/", "_") for name in names]
    if len({name.casefold() for name in flat}) == len(flat):
        return flat
    return [f"{i:0{len(str(len(names)))}}_{name}" for i, name in enumerate(flat)]

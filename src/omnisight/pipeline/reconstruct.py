"""Structure from motion: the counterpart of `omnisight reconstruct`."""

import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import FeatureOptions, Keypoints, detect_features
from omnisight.geometry.pose import Pose
from omnisight.images import collect_images, read_image, read_mask
from omnisight.pipeline.central_camera import CameraSource, camera_of_image
from omnisight.pipeline.options import ReconstructOptions
from omnisight.pipeline.photo import MIN_KEYPOINTS
from omnisight.rig import Rig
from omnisight.sfm.mapping import KeypointRays, map_images
from omnisight.sfm.reconstruction import Reconstruction
from omnisight.sfm.result import build_reconstruction
from omnisight.sfm.view_graph import MIN_INLIERS, Edge, match_pairs, overlapping_pairs

# Called with the stage, the work done and the total.
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class ReconstructionResult:
    """The models of a set of images; false if there is none.

    Attributes
    ----------
    models
        One for each group of images that are connected by common points, the largest first.
    images
        Number of images.
    unregistered
        Names of the images that are in no model, with the reason.
    seconds
        Time of the whole computation.
    reason
        Why there is no model; empty otherwise.
    """

    models: tuple[Reconstruction, ...]
    images: int
    unregistered: dict[str, str] = field(repr=False)
    seconds: float
    reason: str = ""

    def __bool__(self) -> bool:
        """Return whether there is a model."""
        return bool(self.models)


def reconstruct(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    camera: CameraSource | None = None,
    options: ReconstructOptions = ReconstructOptions(),
    progress: Progress = lambda stage, done, total: None,
) -> ReconstructionResult:
    """Estimate the poses of images and the points that they show.

    Keypoints of pairs of images are matched and relative poses estimated; orientations and positions of all images are
    averaged over the pairs; points are triangulated, and refined with the poses by bundle adjustment.

    Parameters
    ----------
    images
        Folder, or image files.
    camera
        The camera of all images, or its calibration file of any format. It may be omitted for equirectangular images of
        360° x 180°, which are twice as wide as high.
    options
        Options of the command.
    progress
        Called with the stage, the work done and the total.

    Returns
    -------
    The models, without scale: the unit of the world is arbitrary.

    Raises
    ------
    ValueError
        If there are no images, one cannot be read, or the camera does not fit.
    """
    start = time.perf_counter()
    inputs = [images] if isinstance(images, str | PathLike) else list(images)
    paths = collect_images([Path(item) for item in inputs])
    names = _names(paths)
    fitted, keypoints, colors = _detect(paths, camera, options, progress)
    edges = _edges(keypoints, options, progress)
    rays = KeypointRays.of(keypoints)
    maps = map_images(keypoints, rays, edges, lambda text: progress(f"mapping: {text}", 0, 1))
    rig = Rig((fitted,), (Pose(),), ("camera",))
    models = tuple(build_reconstruction(found, rays, rig, names, keypoints, colors) for found in maps)
    registered = {name for model in models for name in model.names}
    unregistered = {
        name: _reason(i, keypoints, edges, len(paths)) for i, name in enumerate(names) if name not in registered
    }
    reason = "" if models else next(iter(unregistered.values()))
    return ReconstructionResult(models, len(paths), unregistered, time.perf_counter() - start, reason)


def _detect(
    paths: Sequence[Path], source: CameraSource | None, options: ReconstructOptions, progress: Progress
) -> tuple[Camera, list[Keypoints], list[NDArray[np.uint8]]]:
    """Return the camera for the images, and the keypoints of each with their colours (K, 3)."""
    fitted, mask = None, None
    keypoints: list[Keypoints] = []
    colors: list[NDArray[np.uint8]] = []
    features = FeatureOptions(max_keypoints=options.max_keypoints)
    for path in paths:
        image = read_image(path, apply_exif=options.apply_exif)
        size = image.shape[1], image.shape[0]
        if fitted is None:
            fitted = camera_of_image(source, size, str(path), name=options.name, scale=options.scale_camera)
            mask = None if options.mask is None else read_mask(options.mask, fitted.size)
        elif size != fitted.size:
            raise ValueError(
                f"{path}: is {size[0]}x{size[1]} px, and {paths[0]} {fitted.width}x{fitted.height}: images of one"
                " camera have one size; leave it out, or reconstruct it separately"
            )
        found = detect_features(image, fitted, features, mask=mask)
        columns, rows = np.rint(found.pixels).astype(int).T
        rows, columns = np.clip(rows, 0, size[1] - 1), np.clip(columns, 0, size[0] - 1)
        gray_or_rgb = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
        keypoints.append(found)
        colors.append(_to_uint8(gray_or_rgb[rows, columns, :3]))
        progress("keypoints", len(keypoints), len(paths))
    assert fitted is not None  # `collect_images` returns at least one image
    return fitted, keypoints, colors


def _edges(keypoints: Sequence[Keypoints], options: ReconstructOptions, progress: Progress) -> list[Edge]:
    """Match the selected pairs of images."""
    pairs = list(combinations(range(len(keypoints)), 2))
    if options.pairs == "sequential":
        pairs = [(a, b) for a, b in pairs if b - a <= options.window]
    if options.pairs == "auto":
        pairs = overlapping_pairs(keypoints, pairs, lambda done, total: progress("selecting pairs", done, total))
    return match_pairs(keypoints, pairs, lambda done, total: progress("matching", done, total))


def _reason(image: int, keypoints: Sequence[Keypoints], edges: Sequence[Edge], count: int) -> str:
    """Return why an image is in no model."""
    if count < 2:
        return "one image shows no motion: specify a folder of two or more"
    if len(keypoints[image]) < MIN_KEYPOINTS:
        return f"{len(keypoints[image])} keypoints: the image shows no texture in the field of view of its camera"
    if not any(image in (edge.a, edge.b) for edge in edges):
        return f"no overlap: no other image has {MIN_INLIERS} matches that agree with a motion"
    return "its matches do not agree with the poses of the other images"


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the names of images relative to the folder that contains all of them."""
    parent = Path(os.path.commonpath([path.resolve().parent for path in paths]))
    return [path.resolve().relative_to(parent).as_posix() for path in paths]


def _to_uint8(colors: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours of 8 or 16 bits, or floats from 0 to 1, as 8 bits."""
    if colors.dtype == np.uint8:
        return np.asarray(colors, np.uint8)
    white = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return np.clip(np.nan_to_num(colors.astype(float)) / white * 255, 0, 255).astype(np.uint8)

"""Structure from motion: the counterpart of `omnisight reconstruct`."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from omnisight.images import read_image, read_mask
from omnisight.pipeline.camera_sources import CameraSources, RigSource
from omnisight.pipeline.central_camera import CameraSource, camera_of_image
from omnisight.pipeline.image_set import ImageSet, image_set
from omnisight.pipeline.options import ReconstructOptions
from omnisight.pipeline.photo import MIN_KEYPOINTS
from omnisight.rig import Rig
from omnisight.sfm.extrinsics import estimate_extrinsics
from omnisight.sfm.mapping import Map, map_images
from omnisight.sfm.reconstruction import Reconstruction
from omnisight.sfm.result import build_reconstruction
from omnisight.sfm.rig_images import RigImages
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
    simultaneous
        For a rig, what images that were taken together have in common: "name", "number" or "order".
    """

    models: tuple[Reconstruction, ...]
    images: int
    unregistered: dict[str, str] = field(repr=False)
    seconds: float
    reason: str = ""
    simultaneous: str = ""

    def __bool__(self) -> bool:
        """Return whether there is a model."""
        return bool(self.models)


def reconstruct(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    camera: CameraSource | Mapping[str, CameraSource] | None = None,
    rig: RigSource | None = None,
    options: ReconstructOptions = ReconstructOptions(),
    progress: Progress = lambda stage, done, total: None,
) -> ReconstructionResult:
    """Estimate the poses of images and the points that they show.

    Keypoints of pairs of images are matched and relative poses estimated; orientations and positions of all images are
    averaged over the pairs; points are triangulated, and refined with the poses by bundle adjustment.

    Parameters
    ----------
    images
        Folder, or image files. The sub-folders of a folder without images of its own are searched too.
    camera
        The camera of all images, or its calibration file of any format; or several by name, where the path of each
        image contains the name of its camera, as a folder or in the file name. It may be omitted for equirectangular
        images of 360° x 180°, which are twice as wide as high.
    rig
        In place of `camera`: the cameras and their poses on one rigid body, or the file. Images of its cameras with the
        same name or number were taken at the same time.
    options
        Options of the command.
    progress
        Called with the stage, the work done and the total.

    Returns
    -------
    The models: in metres for a rig of cameras that are apart, otherwise the unit of the world is arbitrary.

    Raises
    ------
    ValueError
        If there are no images, one cannot be read, or a camera does not fit.
    """
    start = time.perf_counter()
    sources = CameraSources.of(camera, rig, options.extrinsics)
    files = image_set(images, sources.names, is_rig=sources.is_rigid)
    cameras, keypoints, colors = _detect(files, sources, options, progress)
    of_cameras = RigImages.of(keypoints, files.camera, len(cameras))
    if sources.poses:
        poses = np.array([pose.matrix for pose in sources.poses])
        of_cameras = of_cameras.on_rig(files.frame, poses, is_known=True)
    edges = _edges(keypoints, of_cameras, options, progress)

    def mapping(refines_sensors: bool) -> list[Map]:
        def watch(done: int) -> None:
            progress("mapping", done, of_cameras.frames)

        return map_images(keypoints, of_cameras, edges, watch, refines_sensors=refines_sensors)

    maps = mapping(sources.refines_extrinsics)
    names = sources.names or ("camera",)
    if sources.estimates_extrinsics and maps:
        poses, _ = estimate_extrinsics(maps[0], of_cameras, files.frame)
        _check_extrinsics(poses, names)
        of_cameras = of_cameras.on_rig(files.frame, poses, is_known=False)
        edges = _with_known_poses(edges, of_cameras, keypoints)
        maps = mapping(refines_sensors=True)
    body = Rig(cameras, tuple(Pose.of_matrix(pose) for pose in of_cameras.sensor_from_rig), names)
    models = tuple(build_reconstruction(found, of_cameras, body, files.names, keypoints, colors) for found in maps)
    registered = {name for model in models for name in model.names}
    unregistered = {
        name: _reason(i, keypoints, edges, len(files)) for i, name in enumerate(files.names) if name not in registered
    }
    reason = "" if models else next(iter(unregistered.values()))
    seconds = time.perf_counter() - start
    return ReconstructionResult(models, len(files), unregistered, seconds, reason, files.rule)


def _detect(
    files: ImageSet, sources: CameraSources, options: ReconstructOptions, progress: Progress
) -> tuple[tuple[Camera, ...], list[Keypoints], list[NDArray[np.uint8]]]:
    """Return the cameras for the images, and the keypoints of each image with their colours (K, 3)."""
    cameras, masks, first = dict[int, Camera](), dict[int, NDArray[np.bool_] | None](), dict[int, Path]()
    keypoints: list[Keypoints] = []
    colors: list[NDArray[np.uint8]] = []
    features = FeatureOptions(max_keypoints=options.max_keypoints)
    for path, k in zip(files.paths, files.camera.tolist(), strict=True):
        image = read_image(path, apply_exif=options.apply_exif)
        size = image.shape[1], image.shape[0]
        if k not in cameras:
            cameras[k] = camera_of_image(
                sources.sources[k], size, str(path), name=options.name, scale=options.scale_camera
            )
            masks[k], first[k] = _read_mask(options.mask, sources.names[k] if sources.names else "", size), path
        elif size != cameras[k].size:
            raise ValueError(
                f"{path}: is {size[0]}x{size[1]} px, and {first[k]} {cameras[k].width}x{cameras[k].height}: images of"
                " one camera have one size; leave it out, or reconstruct it separately"
            )
        found = detect_features(image, cameras[k], features, mask=masks[k])
        columns, rows = np.rint(found.pixels).astype(int).T
        rows, columns = np.clip(rows, 0, size[1] - 1), np.clip(columns, 0, size[0] - 1)
        gray_or_rgb = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, axis=2)
        keypoints.append(found)
        colors.append(_to_uint8(gray_or_rgb[rows, columns, :3]))
        progress("keypoints", len(keypoints), len(files))
    if missing := [name for k, name in enumerate(sources.names) if k not in cameras]:
        raise ValueError(
            f"{files.paths[0].parent}: no images of the camera {missing[0]!r}; leave it out of the cameras"
        )
    return tuple(cameras[k] for k in range(len(cameras))), keypoints, colors


def _read_mask(path: Path | None, camera: str, size: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Return the mask of a camera: that of all, or the file with its name in a folder; None if there is none."""
    if path is None or not path.is_dir():
        return None if path is None else read_mask(path, size)
    named = [file for file in sorted(path.iterdir()) if file.stem == camera]
    return read_mask(named[0], size) if named else None


def _edges(
    keypoints: Sequence[Keypoints], images: RigImages, options: ReconstructOptions, progress: Progress
) -> list[Edge]:
    """Match the selected pairs of images."""
    pairs = list(combinations(range(len(keypoints)), 2))
    if options.pairs == "sequential":
        pairs = [(a, b) for a, b in pairs if abs(images.frame[b] - images.frame[a]) <= options.window]
    if options.pairs == "auto":
        pairs = overlapping_pairs(keypoints, pairs, lambda done, total: progress("selecting pairs", done, total))
    return match_pairs(keypoints, pairs, lambda done, total: progress("matching", done, total), images.known_pose)


def _check_extrinsics(poses: NDArray[np.float64], names: Sequence[str]) -> None:
    """Raise ValueError if the poses (S, 3, 4) of sensors on a rig are not all known."""
    if unknown := [name for name, pose in zip(names, poses, strict=True) if np.isnan(pose).any()]:
        raise ValueError(
            f"the pose of camera {unknown[0]} on the rig is unknown: no image of it is in the largest model together"
            " with an image of another camera taken at the same time; move the rig further, or leave the camera out"
        )


def _with_known_poses(edges: Sequence[Edge], images: RigImages, keypoints: Sequence[Keypoints]) -> list[Edge]:
    """Return the edges, where those between images of one frame have the poses of the rig."""
    together = [(edge.a, edge.b) for edge in edges if images.frame[edge.a] == images.frame[edge.b]]
    others = [edge for edge in edges if images.frame[edge.a] != images.frame[edge.b]]
    return others + match_pairs(keypoints, together, lambda done, total: None, images.known_pose)


def _reason(image: int, keypoints: Sequence[Keypoints], edges: Sequence[Edge], count: int) -> str:
    """Return why an image is in no model."""
    if count < 2:
        return "one image shows no motion: specify a folder of two or more"
    if len(keypoints[image]) < MIN_KEYPOINTS:
        return f"{len(keypoints[image])} keypoints: the image shows no texture in the field of view of its camera"
    if not any(image in (edge.a, edge.b) for edge in edges):
        return f"no overlap: no other image has {MIN_INLIERS} matches that agree with a motion"
    return "its matches do not agree with the poses of the other images"


def _to_uint8(colors: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours of 8 or 16 bits, or floats from 0 to 1, as 8 bits."""
    if colors.dtype == np.uint8:
        return np.asarray(colors, np.uint8)
    white = np.iinfo(colors.dtype).max if np.issubdtype(colors.dtype, np.integer) else 1.0
    return np.clip(np.nan_to_num(colors.astype(float)) / white * 255, 0, 255).astype(np.uint8)

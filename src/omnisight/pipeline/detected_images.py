"""Keypoints of a set of images, through the cameras that took them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import FeatureOptions, Keypoints
from omnisight.images import estimate_image_field, read_image, read_mask, to_gray8
from omnisight.pipeline.camera_sources import CameraSources
from omnisight.pipeline.central_camera import camera_of_image
from omnisight.pipeline.image_set import ImageSet
from omnisight.pipeline.options import ReconstructOptions
from omnisight.pipeline.self_calibration import (
    candidate_cameras,
    change_of_rays,
    prior_sigmas,
    relocated,
    select_camera,
)
from omnisight.pipeline.stored_stages import detect
from omnisight.pipeline.work_folder import WorkFolder
from omnisight.sfm.pixel_rays import FreeCameras

Indices = NDArray[np.intp]
Bytes = NDArray[np.uint8]
# Called with the stage, the work done and the total.
Progress = Callable[[str, int, int], None]

# Images of a camera in which its image circle is detected.
FIELD_IMAGES = 5


@dataclass(frozen=True, eq=False)
class DetectedImages:
    """Keypoints of images.

    Attributes
    ----------
    cameras
        The cameras.
    is_guessed
        Which of them have no calibration.
    camera
        (I,) index of the camera of each image.
    keypoints
        Keypoints of each image.
    colors
        Their colours (K, 3), RGB.
    refines_cameras
        Whether calibrated cameras are refined, with their covariance as the prior.
    """

    cameras: tuple[Camera, ...]
    is_guessed: tuple[bool, ...]
    camera: Indices
    keypoints: list[Keypoints] = field(repr=False)
    colors: list[Bytes] = field(repr=False)
    refines_cameras: bool = False

    @property
    def free_cameras(self) -> FreeCameras | None:
        """The cameras, where those that are guessed can be refined, or all; None if all are fixed."""
        if self.refines_cameras:
            return FreeCameras.of_calibrations(self.cameras)
        if not any(self.is_guessed):
            return None
        cameras = zip(self.cameras, self.is_guessed, strict=True)
        return FreeCameras.of_parameters(self.cameras, [prior_sigmas(each) if guess else {} for each, guess in cameras])

    def of_camera(self, camera: int) -> list[Keypoints]:
        """Return the keypoints of the images of a camera."""
        return [keypoints for keypoints, k in zip(self.keypoints, self.camera, strict=True) if k == camera]

    def seen_by(self, cameras: Sequence[Camera]) -> Self:
        """Return the images with other cameras; keypoints that they do not see are left out."""
        found = [
            relocated(keypoints, self.cameras[k], cameras[k])
            for keypoints, k in zip(self.keypoints, self.camera, strict=True)
        ]
        colors = [rgb[seen] for rgb, (_, seen) in zip(self.colors, found, strict=True)]
        return replace(self, cameras=tuple(cameras), keypoints=[keypoints for keypoints, _ in found], colors=colors)

    def change_of_rays(self, before: Self) -> float:
        """Return the largest median angle, radians, between the rays of a camera and of the one before."""
        pairs = zip(before.cameras, self.cameras, strict=True)
        return max(change_of_rays(old, new, self.of_camera(k)) for k, (old, new) in enumerate(pairs))


def detect_images(
    files: ImageSet,
    sources: CameraSources,
    options: ReconstructOptions,
    progress: Progress,
    work: WorkFolder,
) -> DetectedImages:
    """Read images and detect their keypoints; of cameras without calibration, select the field of view.

    Raises
    ------
    ValueError
        If an image cannot be read or does not fit its camera, or a camera has no images.
    """
    cameras, masks, candidates = dict[int, Camera](), dict[int, NDArray[np.bool_] | None](), dict[int, list[Camera]]()
    keypoints, colors = list[Keypoints](), list[Bytes]()
    for path, k in zip(files.paths, files.camera.tolist(), strict=True):
        image = read_image(path, apply_exif=options.apply_exif)
        size = image.shape[1], image.shape[0]
        if k not in cameras:
            if sources.is_unknown(k, size):
                candidates[k] = _candidates(files, k, options)
            source = candidates[k][0] if k in candidates else sources.sources[k]
            cameras[k] = camera_of_image(source, size, str(path), name=options.name, scale=options.scale_camera)
            masks[k] = _read_mask(options.mask, sources.names[k] if sources.names else "", size)
        elif size != cameras[k].size:
            first = files.paths[files.camera.tolist().index(k)]
            raise ValueError(
                f"{path}: is {size[0]}x{size[1]} px, and {first} {cameras[k].width}x{cameras[k].height}: images of one"
                " camera have one size; leave it out, or reconstruct it separately"
            )
        found, rgb = detect(work, image, cameras[k], FeatureOptions(max_keypoints=options.max_keypoints), masks[k])
        keypoints.append(found)
        colors.append(rgb)
        progress("keypoints", len(keypoints), len(files))
    if missing := [name for k, name in enumerate(sources.names) if k not in cameras]:
        raise ValueError(f"{files.paths[0].parent}: no images of the camera {missing[0]!r}: leave the camera out")
    order = range(len(cameras))
    is_guessed = tuple(k in candidates for k in order)
    detected = DetectedImages(tuple(cameras[k] for k in order), is_guessed, files.camera, keypoints, colors)
    if not candidates:
        return replace(detected, refines_cameras=options.refine_camera)
    if options.refine_camera:
        raise ValueError("a camera without calibration is estimated already: leave refine_camera out")
    return detected.seen_by(
        [select_camera(candidates[k], detected.of_camera(k)) if k in candidates else cameras[k] for k in order]
    )


def _candidates(files: ImageSet, camera: int, options: ReconstructOptions) -> list[Camera]:
    """Return possible cameras of the images of a camera without calibration."""
    paths = [path for path, k in zip(files.paths, files.camera, strict=True) if k == camera][:FIELD_IMAGES]
    images = [to_gray8(read_image(path, apply_exif=options.apply_exif)) for path in paths]
    return candidate_cameras(estimate_image_field([image for image in images if image.shape == images[0].shape]))


def _read_mask(path: Path | None, camera: str, size: tuple[int, int]) -> NDArray[np.bool_] | None:
    """Return the mask of a camera: that of all, or the file with its name in a folder; None if there is none."""
    if path is None or not path.is_dir():
        return None if path is None else read_mask(path, size)
    named = [file for file in sorted(path.iterdir()) if file.stem == camera]
    return read_mask(named[0], size) if named else None

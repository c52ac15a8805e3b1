"""Keypoints of a set of images, through the cameras that took them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features import FeatureOptions, Keypoints
from omnisight.images import UnreadableImage, read_image, reason_without_name
from omnisight.pipeline.inputs.camera_sources import CameraSources
from omnisight.pipeline.inputs.image_set import ImageSet
from omnisight.pipeline.inputs.work_folder import WorkFolder
from omnisight.pipeline.reconstruction.image_cameras import ImageCameras, cameras_of_images
from omnisight.pipeline.reconstruction.keypoint_batch import detect_by_workers
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.self_calibration import change_of_rays, prior_sigmas, relocated, select_camera
from omnisight.pipeline.reconstruction.stored_stages import detect
from omnisight.progress import Progress
from omnisight.sfm.pixel_rays import FreeCameras

Indices = NDArray[np.intp]
Bytes = NDArray[np.uint8]


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
        Keypoints of each image; none of one that cannot be read.
    colors
        Their colours (K, 3), RGB.
    unreadable
        The reason why an image cannot be read, by its index.
    refines_cameras
        Whether calibrated cameras are refined, with their covariance as the prior.
    """

    cameras: tuple[Camera, ...]
    is_guessed: tuple[bool, ...]
    camera: Indices
    keypoints: list[Keypoints] = field(repr=False)
    colors: list[Bytes] = field(repr=False)
    unreadable: Mapping[int, str] = field(default_factory=dict[int, str])
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
        If no image of a camera can be read, or one does not fit its camera.
    """
    chosen = cameras_of_images(files, sources, options)
    detect = detect_by_workers if options.has_workers else _detect_in_turn
    found = list(detect(files, chosen, options, progress, work))
    errors = {i: each for i, each in enumerate(found) if isinstance(each, UnreadableImage)}
    unreadable = {i: reason_without_name(error, files.paths[i]) for i, error in errors.items()}
    some, some_colors = next(each for each in found if not isinstance(each, UnreadableImage))
    none = some[:0], some_colors[:0]
    keypoints, colors = zip(*(none if isinstance(each, UnreadableImage) else each for each in found), strict=True)
    is_guessed = tuple(bool(candidates) for candidates in chosen.candidates)
    detected = DetectedImages(chosen.cameras, is_guessed, files.camera, list(keypoints), list(colors), unreadable)
    if not any(is_guessed):
        return replace(detected, refines_cameras=options.refine_camera)
    if options.refine_camera:
        raise ValueError("a camera without calibration is estimated already: leave refine_camera out")
    return detected.seen_by(
        [
            select_camera(candidates, detected.of_camera(k)) if candidates else camera
            for k, (camera, candidates) in enumerate(zip(chosen.cameras, chosen.candidates, strict=True))
        ]
    )


def _detect_in_turn(
    files: ImageSet, chosen: ImageCameras, options: ReconstructOptions, progress: Progress, work: WorkFolder
) -> Iterator[tuple[Keypoints, Bytes] | UnreadableImage]:
    """Yield the keypoints of each image and their colours, which the work folder keeps, or why it cannot be read."""
    features = FeatureOptions(max_keypoints=options.max_keypoints)
    for done, (path, k) in enumerate(zip(files.paths, files.camera.tolist(), strict=True)):
        try:
            image = read_image(path, apply_exif=options.apply_exif)
        except UnreadableImage as error:
            yield error
        else:
            chosen.check_size(image, str(path), k)
            yield detect(work, image, chosen.cameras[k], features, chosen.masks[k])
        progress("keypoints", done + 1, len(files))

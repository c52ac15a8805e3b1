"""The cameras that took a set of images, their masks, and the candidates for those without calibration."""

from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.images import estimate_image_field, readable_images, to_gray8
from omnisight.pipeline.inputs.camera_sources import CameraSources
from omnisight.pipeline.inputs.central_camera import camera_of_image
from omnisight.pipeline.inputs.image_set import ImageSet
from omnisight.pipeline.inputs.images_of_cameras import read_masks
from omnisight.pipeline.reconstruction.reconstruct_options import ReconstructOptions
from omnisight.pipeline.reconstruction.self_calibration import candidate_cameras

Mask = NDArray[np.bool_]

# Images of a camera in which its image circle is detected.
FIELD_IMAGES = 5


@dataclass(frozen=True, eq=False)
class ImageCameras:
    """Cameras of a set of images.

    Attributes
    ----------
    cameras
        The cameras; of those without calibration the first candidate.
    masks
        Pixels (H, W) of each in which keypoints are wanted; None for all.
    candidates
        Possible cameras of each without calibration; none for the others.
    first
        Name of the first image of each that can be read, for messages.
    """

    cameras: tuple[Camera, ...]
    masks: tuple[Mask | None, ...]
    candidates: tuple[list[Camera], ...]
    first: tuple[str, ...]

    def check_size(self, image: NDArray[Any], name: str, camera: int) -> None:
        """Raise ValueError if an image has another size than its camera."""
        size, (width, height) = (image.shape[1], image.shape[0]), self.cameras[camera].size
        if size != (width, height):
            raise ValueError(
                f"{name}: is {size[0]}x{size[1]} px, and {self.first[camera]} {width}x{height}: images of one camera"
                " have one size; leave it out, or reconstruct it separately"
            )


def cameras_of_images(files: ImageSet, sources: CameraSources, options: ReconstructOptions) -> ImageCameras:
    """Return the camera of each image, by the size of the first one that can be read.

    Raises
    ------
    ValueError
        If no image of a camera can be read, or a camera does not fit its first one.
    """
    of_image = files.camera.tolist()
    if missing := [name for k, name in enumerate(sources.names) if k not in of_image]:
        raise ValueError(f"{files.paths[0].parent}: no images of the camera {missing[0]!r}: leave the camera out")
    cameras, candidates = list[Camera](), list[list[Camera]]()
    first = list[str]()
    for k in range(len(sources.sources)):
        path, image = next(readable_images(files.of_camera(k), apply_exif=options.apply_exif))
        first.append(str(path))
        size = image.shape[1], image.shape[0]
        candidates.append(_candidates(files, k, options) if sources.is_unknown(k, size) else [])
        source = candidates[k][0] if candidates[k] else sources.sources[k]
        cameras.append(camera_of_image(source, size, str(path), name=options.name, scale=options.scale_camera))
    masks = read_masks(options.mask, sources.names, [camera.size for camera in cameras])
    return ImageCameras(tuple(cameras), tuple(masks), tuple(candidates), tuple(first))


def _candidates(files: ImageSet, camera: int, options: ReconstructOptions) -> list[Camera]:
    """Return possible cameras of the images of a camera without calibration."""
    readable = islice(readable_images(files.of_camera(camera), apply_exif=options.apply_exif), FIELD_IMAGES)
    images = [to_gray8(image) for _, image in readable]
    return candidate_cameras(estimate_image_field([image for image in images if image.shape == images[0].shape]))

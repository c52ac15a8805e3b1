"""The two images of a stereo pair with the cameras and masks that belong to them."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.extensions import did_you_mean
from omnisight.formats import load_rig
from omnisight.geometry.pose import Pose
from omnisight.images import read_mask
from omnisight.pipeline.inputs.camera_sources import RigSource
from omnisight.pipeline.inputs.central_camera import fit_camera
from omnisight.pipeline.inputs.photo import ImageSource, Photo, read_source
from omnisight.pipeline.two_views.two_view_options import StereoOptions
from omnisight.rig import Rig


def load_pair(
    images: tuple[ImageSource, ImageSource], rig: RigSource, options: StereoOptions
) -> tuple[tuple[Photo, Photo], Pose, str]:
    """Return both images with their cameras, the pose right_from_left of the cameras, and its unit of length.

    Raises
    ------
    ValueError
        If a file cannot be read, the rig does not determine two central cameras, or an image or a mask does not have
        the size of its camera.
    """
    label = "the rig" if isinstance(rig, Rig) else str(rig)
    body = rig if isinstance(rig, Rig) else load_rig(Path(rig))
    i, j = _indices(body, options.cameras, label)
    left, right = (
        _photo(source, side, _central(body, k, label), mask, options)
        for source, side, k, mask in zip(
            images, ("left", "right"), (i, j), (options.mask_left, options.mask_right), strict=True
        )
    )
    return (left, right), body.sensor_from_rig[j] @ body.sensor_from_rig[i].inverse(), body.unit


def _indices(rig: Rig, cameras: str | None, label: str) -> tuple[int, int]:
    """Return the indices of the left and the right camera."""
    names = ", ".join(rig.names)
    if cameras is None:
        if len(rig) != 2:
            example = ",".join(rig.names[:2]) if len(rig) > 1 else "left,right"
            raise ValueError(
                f"{label}: has {len(rig)} cameras ({names}), and stereo needs two: "
                + (f"specify them, such as --cameras {example}" if len(rig) > 2 else "use the file of a rig")
            )
        return 0, 1
    chosen = [name.strip() for name in cameras.split(",")]
    if len(chosen) != 2 or chosen[0] == chosen[1]:
        raise ValueError(f"--cameras {cameras}: must be the names of two cameras, left,right; the rig has {names}")
    missing = [name for name in chosen if name not in rig.names]
    if missing:
        closest = did_you_mean(missing[0], rig.names)
        raise ValueError(f"{label}: has no camera {missing[0]!r} (--cameras){closest}; it has {names}")
    return rig.index(chosen[0]), rig.index(chosen[1])


def _central(rig: Rig, index: int, label: str) -> Camera:
    camera = rig.cameras[index]
    if isinstance(camera, Camera):
        return camera
    raise ValueError(
        f"{label}: {rig.names[index]} is a non-central camera ({camera.model.name}), which stereo does not support: use"
        " a rig of central cameras"
    )


def _photo(source: ImageSource, side: str, camera: Camera, mask: Path | None, options: StereoOptions) -> Photo:
    """Return an image with its camera, scaled on request, and its mask."""
    label, image = read_source(source, f"{side} image", options.apply_exif)
    size = image.shape[1], image.shape[0]
    camera = fit_camera(camera, size, label, scale=options.scale_camera)
    allowed: NDArray[Any] | None = None if mask is None else read_mask(mask, size)
    if allowed is not None and not allowed.any():
        raise ValueError(f"{mask}: excludes all pixels of {label}; paint the areas to use white")
    return Photo(label, image, camera, allowed)

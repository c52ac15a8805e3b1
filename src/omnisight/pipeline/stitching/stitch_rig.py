"""The rig of a stitch: given, of two calibrated cameras, or estimated from the overlap."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.features.detection import illuminated_region
from omnisight.geometry.pose import Pose
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import read_mask, to_gray8
from omnisight.images.image_field import ImageField
from omnisight.pipeline.inputs.central_camera import camera_of_image, fit_camera
from omnisight.pipeline.inputs.images_of_cameras import check_order
from omnisight.pipeline.stitching.stitch_inputs import HEAD_NAMES, Bytes, HeadFrames, lens_fields
from omnisight.pipeline.stitching.stitch_options import StitchOptions
from omnisight.rig import Rig
from omnisight.sfm.head_calibration import calibrate_head, estimate_head_rotation
from omnisight.sfm.head_result import HeadCalibration
from omnisight.views.maps import resolution
from omnisight.views.stitching.sampling import Sampler

Mask = NDArray[np.bool_]

# Pixels at the rim of an image circle are dark and blurred: largest distance kept from it, as a share of the radius.
RIM_MARGIN = 0.015
# Azimuths at which the edge of a field of view is measured.
SECTORS = 360


@dataclass(frozen=True, eq=False)
class HeadRig:
    """Cameras that are stitched.

    Attributes
    ----------
    rig
        The rig.
    allowed
        For each camera which pixels (H, W) show the scene and are allowed by its mask.
    calibration
        The estimate of lenses and rotation, if they were not given.
    """

    rig: Rig
    allowed: tuple[Mask, ...]
    calibration: HeadCalibration | None = None

    def samplers(self) -> list[Sampler]:
        """Return the cameras without parallax."""
        triples = zip(self.rig.cameras, self.rig.sensor_from_rig, self.allowed, strict=True)
        return [Sampler(camera, pose, allowed) for camera, pose, allowed in triples if isinstance(camera, Camera)]

    def native_width(self) -> int:
        """Return the width of a sphere with the resolution of the cameras on their axes, a multiple of 64 px."""
        per_radian = [
            float(resolution(camera, np.array([[0.05, 0.0, 1.0]]))[0])
            for camera in self.rig.cameras
            if isinstance(camera, Camera)
        ]
        return int(min(max(64 * round(2 * np.pi * max(per_radian) / 64), 64), 16384))


def head_rig(
    frames: HeadFrames,
    rig: Rig | None,
    cameras: Sequence[Camera | str | PathLike[str]],
    options: StitchOptions,
) -> HeadRig:
    """Return the rig of frames.

    Raises
    ------
    ValueError
        If the number or the sizes of images and cameras differ, or an unknown head cannot be calibrated.
    """
    if rig is not None and cameras:
        raise ValueError("specify a rig or cameras, not both: the rig contains its cameras")
    if rig is not None:
        return _given(frames, rig, options)
    if options.at not in ("auto", "inf"):
        raise ValueError(f"--at {options.at}: without a rig the lenses are apart by an unknown length: specify --rig")
    samples = frames.calibration_frames()
    if not samples:
        raise ValueError("the clips have no common frame: specify clips that were recorded at the same time")
    if len(samples[0]) != 2:
        raise ValueError(
            f"there are {len(samples[0])} images, and without a rig exactly two lenses can be stitched: specify --rig"
        )
    _check_distinct(samples[0], frames)
    masks = _masks(options, samples[0])
    if cameras:
        return _calibrated_lenses(samples, cameras, masks, options)
    sizes = {image.shape[:2] for image in samples[0]}
    if len(sizes) > 1:
        listed = " and ".join(f"{image.shape[1]}x{image.shape[0]}" for image in samples[0])
        raise ValueError(f"{frames.first}: are of different sizes ({listed}): specify the rig, or the camera of each")
    fields = lens_fields(frames, samples)
    allowed = tuple(_in_circle(lens.field, mask) for lens, mask in zip(fields, masks, strict=True))
    pairs = [(frame[0], frame[1]) for frame in samples]
    found = calibrate_head(pairs, fields, (allowed[0], allowed[1]))
    if found:
        first, second = (_with_field(camera, mask) for camera, mask in zip(found.cameras, allowed, strict=True))
        found = replace(found, cameras=(first, second))
    return _estimated(found, allowed)


def _with_field(camera: Camera, shown: Mask) -> Camera:
    """Return a camera with the field of view of the pixels that show the scene: its file has no image circle.

    The circle is not exactly around the principal point: the field is the median over all azimuths.
    """
    bearings, valid = camera.unproject(np.argwhere(shown)[:, ::-1].astype(float))
    azimuth = np.arctan2(bearings[valid, 1], bearings[valid, 0])
    edge, sector = np.zeros(SECTORS), ((azimuth / (2 * np.pi) % 1.0) * SECTORS).astype(int) % SECTORS
    np.maximum.at(edge, sector, angle_from_axis(bearings[valid]))
    return replace(camera, theta_max=float(np.median(edge)))


def _given(frames: HeadFrames, rig: Rig, options: StitchOptions) -> HeadRig:
    images = next(iter(frames))
    if len(images) != len(rig):
        names = ", ".join(rig.names)
        raise ValueError(f"there are {len(images)} images, and the rig has {len(rig)} cameras ({names}), in this order")
    check_order(frames.sources[0], rig.names)
    _check_distinct(images, frames)
    fitted: list[Camera] = []
    for k, (camera, image) in enumerate(zip(rig.cameras, images, strict=True)):
        if not isinstance(camera, Camera):
            raise ValueError(f"{rig.names[k]} is a non-central camera ({camera.model.name}): use central cameras")
        size = image.shape[1], image.shape[0]
        fitted.append(fit_camera(camera, size, f"image {k + 1} ({rig.names[k]})", scale=options.scale_camera))
    masks = _masks(options, images)
    shown = [
        illuminated_region(to_gray8(image), camera) & mask
        for image, camera, mask in zip(images, fitted, masks, strict=True)
    ]
    return HeadRig(Rig(tuple(fitted), rig.sensor_from_rig, rig.names, unit=rig.unit), tuple(shown))


def _calibrated_lenses(
    samples: Sequence[Sequence[Bytes]],
    cameras: Sequence[Camera | str | PathLike[str]],
    masks: Sequence[Mask],
    options: StitchOptions,
) -> HeadRig:
    if len(cameras) != 2:
        raise ValueError(f"specify the camera of each of the two images, got {len(cameras)}")
    fitted: list[Camera] = []
    for k, source in enumerate(cameras):
        size = samples[0][k].shape[1], samples[0][k].shape[0]
        given = source if isinstance(source, Camera) else Path(source)
        fitted.append(camera_of_image(given, size, f"image {k + 1}", name=None, scale=options.scale_camera))
    allowed = tuple(
        illuminated_region(to_gray8(image), camera) & mask
        for image, camera, mask in zip(samples[0], fitted, masks, strict=True)
    )
    pairs = [(frame[0], frame[1]) for frame in samples]
    found = estimate_head_rotation(pairs, (fitted[0], fitted[1]), (allowed[0], allowed[1]))
    return _estimated(found, allowed)


def _check_distinct(images: Sequence[Bytes], frames: HeadFrames) -> None:
    """Raise `ValueError` if two images are identical."""
    for k in range(1, len(images)):
        if images[k].shape == images[0].shape and np.array_equal(images[k], images[0]):
            raise ValueError(f"{frames.first}: images 1 and {k + 1} are identical; specify the image of each camera")


def _estimated(found: HeadCalibration, allowed: tuple[Mask, ...]) -> HeadRig:
    if not found:
        raise ValueError(
            f"the images cannot be stitched without a rig: {found.reason}. Specify images that both lenses took at the"
            " same time, with overlap and texture, or a calibrated rig (--rig)"
        )
    return HeadRig(Rig(found.cameras, (Pose(), Pose(found.rotation, np.zeros(3))), HEAD_NAMES), allowed, found)


def _masks(options: StitchOptions, images: Sequence[Bytes]) -> list[Mask]:
    """Return the masks of all cameras."""
    sizes = [(image.shape[1], image.shape[0]) for image in images]
    if not options.mask:
        return [np.ones(size[::-1], np.bool_) for size in sizes]
    if len(options.mask) != len(images):
        raise ValueError(
            f"there are {len(options.mask)} masks and {len(images)} cameras: specify one for each, in order"
        )
    masks = [read_mask(path, size) for path, size in zip(options.mask, sizes, strict=True)]
    for path, mask in zip(options.mask, masks, strict=True):
        if not mask.any():
            raise ValueError(f"{path}: excludes all pixels; paint the areas to use white")
    return masks


def _in_circle(field: ImageField, mask: Mask) -> Mask:
    """Return which pixels are inside the image circle where it is fully bright."""
    height, width = mask.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    radius = field.outer.radius if field.outer else 0.0
    inner = min(field.outer_fade, RIM_MARGIN * radius)
    return mask & field.contains(grid, field.outer_fade + inner)

"""Bird's-eye views from the images of a rig: the ground around a vehicle from above."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.calibration.ground_calibration import GroundCalibration, GroundMarks, length_errors
from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.features.detection import illuminated_region
from omnisight.formats import FormatError, load, load_rig
from omnisight.geometry.pose import Pose
from omnisight.images import read_image
from omnisight.images.gray import to_gray8
from omnisight.pipeline.birdseye.birdseye_options import BirdseyeOptions
from omnisight.pipeline.birdseye.ground_rig import ground_rig
from omnisight.pipeline.birdseye.vehicle import camera_rectangle, vehicle_occlusion
from omnisight.pipeline.inputs.camera_sources import RigSource
from omnisight.pipeline.inputs.central_camera import CameraSource, fit_camera, load_sensor
from omnisight.pipeline.inputs.images_of_cameras import load_masks, match_cameras
from omnisight.rig import Rig
from omnisight.targets.length import parse_length
from omnisight.views.ground_view import Bowl, GroundView
from omnisight.views.image_order import likely_order
from omnisight.views.image_size import check_size
from omnisight.views.surround_remapper import SurroundRemapper

Image = NDArray[Any]
Mask = NDArray[np.bool_]
BodySource = RigSource | Mapping[str, CameraSource]
ImageSources = Mapping[str, Image | str | Path] | Sequence[Image | str | Path]


@dataclass(frozen=True)
class LengthErrors:
    """Errors of known lengths between marks on the ground, cm.

    Attributes
    ----------
    median, maximum
        Of their absolute values; NaN without lengths.
    count
        Number of lengths.
    """

    median: float
    maximum: float
    count: int


@dataclass(frozen=True, eq=False)
class BirdseyeRenderer(Displayed):
    """A calibrated view of a rig, for any number of frames.

    Attributes
    ----------
    view
        The view of the ground.
    calibration
        The rig in the frame of the ground, and how it was calibrated.
    remapper
        The maps of the cameras.
    unseen
        (H, W) pixels of the view that no camera sees, without those of the vehicle.
    gain
        Whether the images are equalized.
    """

    view: GroundView
    calibration: GroundCalibration
    remapper: SurroundRemapper = field(repr=False)
    unseen: Mask = field(repr=False)
    gain: bool = True

    def __call__(self, images: Sequence[Image]) -> Image:
        """Return the view (H, W, 3) of simultaneous images, in the order of the cameras."""
        check_sizes(images, self.calibration.rig)
        return self.remapper(images, self.gains(images))

    def gains(self, images: Sequence[Image]) -> NDArray[np.float32] | None:
        """Return the gains (C, 3) of the images; None if they are not equalized."""
        return self.remapper.gains(images) if self.gain else None

    @property
    def ground_share(self) -> tuple[float, ...]:
        """For each camera the share of the view that shows its image."""
        return tuple(float(w.mean()) for w in self.remapper.weights)


@dataclass(frozen=True, eq=False)
class BirdseyeResult(Displayed):
    """A bird's-eye view and how it was made.

    Attributes
    ----------
    image
        (H, W, 3), forward is up.
    renderer
        The view, the calibrated rig and the maps, for further frames.
    seam_step
        Median difference of mean levels of neighbouring images where they overlap, after equalization.
    order
        For each camera the index of the image that is likely its own; None if the given order is not refuted.
    seconds
        Time of the whole computation.
    """

    image: Image = field(repr=False)
    renderer: BirdseyeRenderer
    seam_step: float
    order: tuple[int, ...] | None
    seconds: float

    @property
    def warning(self) -> str:
        """What is likely wrong with the images; empty if nothing."""
        if self.order is None:
            return ""
        names, pairs = self.rig.names, enumerate(self.order)
        wrong = [f"that of {names[image]} is likely of {names[camera]}" for camera, image in pairs if camera != image]
        return (
            f"images are likely exchanged ({', '.join(wrong)}): check their names, and the names in the file of the rig"
        )

    @property
    def rig(self) -> Rig:
        """The rig in the frame of the ground."""
        return self.renderer.calibration.rig

    def length_errors(self, *cameras: str, across: bool = False) -> LengthErrors:
        """Return the errors of lengths between marks of some cameras, by default all; or only between two cameras."""
        return length_errors_cm(self.renderer.calibration, cameras or self.rig.names, across=across)


def birdseye(images: ImageSources, rig: BodySource, options: BirdseyeOptions = BirdseyeOptions()) -> BirdseyeResult:
    """Compute a view of the ground from above from simultaneous images of a rig, whose cameras may be of any model.

    Every pixel of the view is a point of the ground, or of a bowl around the vehicle, that is projected to each
    camera. It shows the camera that resolves it best; images are equalized and blended at the seams.

    Parameters
    ----------
    images
        The images or their files: by camera name, or in the order of the cameras. Files are matched by their names.
    rig
        The rig, or its file; or that of its only camera; or cameras or their files by name, whose poses follow from
        marks on the ground.
    options
        Options of the command.

    Raises
    ------
    ValueError
        If a file cannot be read, the images are not those of the cameras, the ground is not determined, or a camera
        sees none of it.
    """
    start = time.perf_counter()
    body = load_body(rig, options)
    frames = load_images(images, body, options)
    renderer = prepare_birdseye(frames, body, options)
    gains = renderer.gains(frames)
    image = renderer.remapper(frames, gains)
    return birdseye_result(image, renderer, frames, gains, start)


def birdseye_result(
    image: Image, renderer: BirdseyeRenderer, images: Sequence[Image], gains: NDArray[np.float32] | None, start: float
) -> BirdseyeResult:
    """Return the result of a view, with the measures of its images and gains; `start` is that of `perf_counter`."""
    step, order = renderer.remapper.seam_step(images, gains), likely_order(renderer.remapper, images)
    return BirdseyeResult(image, renderer, step, order, time.perf_counter() - start)


def prepare_birdseye(images: Sequence[Image], rig: Rig, options: BirdseyeOptions) -> BirdseyeRenderer:
    """Return the renderer of a rig, calibrated with simultaneous images in the order of its cameras; see `birdseye`."""
    rig = _fitted(rig, images, options.scale_camera)
    calibration = ground_rig(rig, images, options)
    view = ground_view(calibration.rig, options)
    sizes = {name: camera.size for name, camera in zip(rig.names, rig.cameras, strict=True)}
    given = load_masks(options.masks, rig.names, sizes)
    masks = [_used(image, rig, k, given[k]) for k, image in enumerate(images)]
    hidden = vehicle_occlusion(calibration.rig, view, options.vehicle)
    feather = parse_length(options.blend, "--blend") / view.meters_per_pixel
    remapper = SurroundRemapper(calibration.rig, view.points(), feather_px=feather, hidden=hidden, masks=masks)
    for k, name in enumerate(rig.names):
        if hidden is not None and hidden[k].all():
            raise ValueError(
                f"the vehicle covers the whole view of {name}: specify its size (--vehicle), or more ground (--margin)"
            )
        if not remapper.maps[k].visible.any():
            raise ValueError(
                f"{name} sees none of the ground of the view: check its pose in the rig and the height of the rig,"
                " leave the camera out, or determine the poses from marks on the ground (--ground marks.json)"
            )
    unseen = ~remapper.covered
    if hidden is not None:
        unseen &= ~np.logical_and.reduce(hidden)
    return BirdseyeRenderer(view, calibration, remapper, unseen, options.gain)


def ground_view(rig: Rig, options: BirdseyeOptions) -> GroundView:
    """Return the view of a rig in the ground frame: the rectangle of its cameras and a margin."""
    left, right, back, front = camera_rectangle(rig)
    margin = parse_length(options.margin, "--margin")
    bowl = None
    if options.bowl is not None:
        flat = parse_length(options.bowl, "--bowl")
        half = max(-left, right) + flat, max(-back, front) + flat
        bowl = Bowl(half, flat)
    return GroundView(
        parse_length(options.pixel, "--pixel"), (left - margin, right + margin, back - margin, front + margin), bowl
    )


def load_body(source: BodySource, options: BirdseyeOptions) -> Rig:
    """Return a rig: read from its file; of one camera, in its frame; or of cameras of unknown poses.

    Raises
    ------
    ValueError
        If a file cannot be read, or the poses are unknown and there are no marks on the ground.
    """
    if isinstance(source, Rig):
        return source
    if isinstance(source, Mapping):
        if options.ground is None:
            raise ValueError(
                "the poses of the cameras are unknown: specify marks on the ground that each of them sees (--ground"
                " marks.json), or a file of the rig (--rig)"
            )
        cameras = {name: each if isinstance(each, Camera) else load_sensor(each, name) for name, each in source.items()}
        return Rig.from_sensors({name: (camera, Pose()) for name, camera in cameras.items()})
    path = Path(source)
    try:
        return load_rig(path)
    except FormatError as no_rig:
        try:
            return Rig.from_sensors({path.stem: (load(path, option=None), Pose())})
        except FormatError:
            raise no_rig from None


def load_images(images: ImageSources, rig: Rig, options: BirdseyeOptions) -> list[Image]:
    """Return the images in the order of the cameras, read if they are files."""
    if isinstance(images, Mapping):
        unknown = [name for name in images if name not in rig.names]
        missing = [name for name in rig.names if name not in images]
        if unknown or missing:
            raise ValueError(
                f"the images are of {', '.join(images)}, the cameras of the rig are {', '.join(rig.names)}: one image"
                " for each camera is needed"
            )
        ordered = [images[name] for name in rig.names]
    elif images and all(isinstance(image, str | Path) for image in images):
        ordered = match_cameras([Path(str(image)) for image in images], rig.names)
    else:
        ordered = list(images)
    if len(ordered) != len(rig):
        raise ValueError(f"{len(ordered)} images for the {len(rig)} cameras of the rig: {', '.join(rig.names)}")
    return [i if isinstance(i, np.ndarray) else read_image(Path(i), apply_exif=options.apply_exif) for i in ordered]


def length_errors_cm(calibration: GroundCalibration, cameras: Sequence[str], *, across: bool = False) -> LengthErrors:
    """Return the errors, cm, of the lengths between marks of some cameras that are no outliers; see `length_errors`."""
    inliers = {
        name: GroundMarks(calibration.marks[name].pixels[fit.inliers], calibration.marks[name].ground[fit.inliers])
        for name, fit in calibration.fits.items()
        if name in cameras and name in calibration.marks
    }
    errors = 100 * np.abs(length_errors(calibration.rig, inliers, across=across)) if inliers else np.zeros(0)
    if not len(errors):
        return LengthErrors(float("nan"), float("nan"), 0)
    return LengthErrors(float(np.median(errors)), float(errors.max()), len(errors))


def check_sizes(images: Sequence[Image], rig: Rig) -> None:
    """Raise `ValueError` if an image has not the size of its camera."""
    for name, camera, image in zip(rig.names, rig.cameras, images, strict=True):
        check_size((image.shape[1], image.shape[0]), camera.size, name)


def _fitted(rig: Rig, images: Sequence[Image], scale: bool) -> Rig:
    """Return the rig with cameras of the sizes of the images."""
    cameras = [
        fit_camera(camera, (image.shape[1], image.shape[0]), name, scale=scale)
        if isinstance(camera, Camera)
        else camera
        for name, camera, image in zip(rig.names, rig.cameras, images, strict=True)
    ]
    fitted = replace(rig, cameras=tuple(cameras))
    check_sizes(images, fitted)
    return fitted


def _used(image: Image, rig: Rig, index: int, mask: Mask | None) -> Mask | None:
    """Return the pixels (H, W) that show the scene and are allowed by a mask; None for all."""
    camera = rig.cameras[index]
    if not isinstance(camera, Camera):
        return mask
    shown = illuminated_region(to_gray8(image), camera)
    return shown if mask is None else shown & mask

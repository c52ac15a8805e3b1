"""Views of image files: the counterpart of `omnisight view`."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.formats import save
from omnisight.geometry.rotation import look
from omnisight.images import collect_images, read_image, write_image
from omnisight.images.output_paths import output_paths, refuse_overwrite
from omnisight.pipeline.central_camera import central_camera, fit_camera
from omnisight.views.cube import CUBE_FACES, cube_cross, cube_rotation
from omnisight.views.maps import extrapolation_mask, visible_fraction
from omnisight.views.remapper import Interpolation, Remapper, magnification
from omnisight.views.view_cameras import (
    FisheyeProjection,
    cube_face,
    cylinder,
    fisheye,
    mercator,
    panini,
    perspective,
    planet,
    sphere,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Range = tuple[float, float]
Progress = Callable[[str, int, int], None]
ViewType = Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"]

PANORAMAS = {"cylinder": cylinder, "mercator": mercator, "sphere": sphere}
DEFAULT_FOV_DEG = {"perspective": 90.0, "panini": 150.0, "planet": 260.0, "fisheye": 180.0}
# Elevation at which the default cylinder of a mirror camera ends: farther up or down it is stretched threefold.
MAX_CYLINDER_ELEVATION_DEG = 60.0
# Period and width of the hatching lines, px along a row.
HATCH_PERIOD_PX, HATCH_LINE_PX = 16, 2


@dataclass(frozen=True)
class ViewOptions(Displayed):
    """Options of `view`. Angles are in degrees: +yaw right, +pitch up, +roll clockwise as seen.

    Attributes
    ----------
    to
        Type of the view: perspective by default, and a cylinder of a mirror camera, which is blind along its axis.
    fov
        Field of view: horizontal for perspective (90), panini (150) and planet (260), diameter for fisheye (180).
    yaw, pitch, roll
        View direction. The pitch is 0, and -90 for a planet, by default.
    up
        Where the world's up is: "top" of the image; "back", for a camera that looks down or into a mirror above it;
        "front", for one that looks up. By default "back" for a mirror camera, "top" for others.
    flip
        Exchange left and right, for a camera that looks into one mirror.
    size
        (width, height), px; cylinder, mercator and sphere use only the width.
    elevation, azimuth
        (low, high), field of view of a cylinder, mercator or sphere.
    projection
        Projection of a fisheye.
    interpolation
        Interpolation between image pixels.
    antialias
        Average image pixels where the view is smaller than the image.
    mark
        Hatch the pixels outside the calibrated field of view.
    scale_camera
        Scale the camera to the size of the images.
    name
        Name of the camera in a file of several, such as a rig.
    distance
        Scene distance with its unit ("2m", "inf"), for the file of a non-central camera.
    apply_exif
        Rotate images by their EXIF orientation.
    """

    to: ViewType | None = None
    fov: float | None = None
    yaw: float = 0.0
    pitch: float | None = None
    roll: float = 0.0
    up: Literal["top", "back", "front"] | None = None
    flip: bool = False
    size: tuple[int, int] | None = None
    elevation: Range | None = None
    azimuth: Range | None = None
    projection: FisheyeProjection = "equidistant"
    interpolation: Interpolation = "bicubic"
    antialias: bool = True
    mark: bool = False
    scale_camera: bool = False
    name: str | None = None
    distance: str | None = None
    apply_exif: bool = False

    def __post_init__(self) -> None:
        """Check that angles are finite and that the field of view is specified in the way of the view type."""
        for name, angle in (("yaw", self.yaw), ("pitch", self.pitch or 0.0), ("roll", self.roll)):
            if not math.isfinite(angle):
                raise ValueError(f"--{name} must be a number of degrees, got {angle}")
        if self.to is not None and self.to not in PANORAMAS:
            for name in ("elevation", "azimuth"):
                if getattr(self, name) is not None:
                    raise ValueError(f"--{name} applies to cylinder, mercator and sphere; use --fov for a {self.to}")
        if self.fov is not None and self.to is not None and self.to not in DEFAULT_FOV_DEG:
            remedy = "its faces are 90 degrees wide" if self.to == "cube" else "use --azimuth"
            raise ValueError(f"--fov does not apply to a {self.to}; {remedy}")

    def for_camera(self, camera: Camera) -> "ViewOptions":
        """Return the options with the defaults for a camera: those of a mirror camera avoid the blind spot."""
        is_mirror = camera.theta_min > 0
        panorama = is_mirror and self.fov is None
        options = dataclasses.replace(
            self,
            to=self.to or ("cylinder" if panorama else "perspective"),
            up=self.up or ("back" if is_mirror else "top"),
        )
        if options.to != "cylinder" or not is_mirror or options.up == "top" or self.elevation is not None:
            return options
        low, high = (math.degrees(theta) - 90 for theta in (camera.theta_min, camera.theta_max or math.pi))
        low, high = max(low, -MAX_CYLINDER_ELEVATION_DEG), min(high, MAX_CYLINDER_ELEVATION_DEG)
        if low >= high:
            return options
        return dataclasses.replace(options, elevation=(low, high) if options.up == "back" else (-high, -low))

    @property
    def view_from_source(self) -> Array:
        """Rotation (3, 3) from the source camera to the view."""
        pitch = (-90.0 if self.to == "planet" else 0.0) if self.pitch is None else self.pitch
        return look(self.yaw, pitch, self.roll, up=self.up or "top", flip=self.flip)


@dataclass(frozen=True)
class ViewResult:
    """Views that were written.

    Attributes
    ----------
    options
        The options with the defaults for the camera.
    files
        The views that were written.
    source, target
        The camera of the images, scaled to them, and the camera of the view (of one face of a cube).
    rotations
        target_from_source (3, 3) of the view, or of each face of a cube.
    image_fraction
        Share of the image that the view shows.
    view_fraction
        Share of the view that the image covers.
    extrapolated_fraction
        Share of the covered view that is outside the calibrated field of view.
    magnification
        Size of an image pixel in the view, px, in the centre and at the edge.
    errors
        Messages of the images that were skipped.
    """

    options: ViewOptions
    files: tuple[Path, ...]
    source: Camera
    target: Camera
    rotations: tuple[Array, ...]
    image_fraction: float
    view_fraction: float
    extrapolated_fraction: float
    magnification: tuple[float, float]
    errors: tuple[str, ...]


def view(
    images: Sequence[str | Path],
    camera: Camera | Path,
    output: Path,
    options: ViewOptions | None = None,
    *,
    mask: Path | None = None,
    view_camera: Path | None = None,
    progress: Progress | None = None,
) -> ViewResult:
    """Turn image files into views and write them.

    Parameters
    ----------
    images
        Image files, folders or patterns; all images are of the same size.
    camera
        The camera of the images, or its calibration file of any format.
    output
        File of the view, or a folder; several images need a folder, which is created.
    options
        The view.
    mask
        Write the mask of covered pixels as a PNG: 255 where the image covers the view.
    view_camera
        Write the camera of the view; its provenance has the rotation.
    progress
        Called with a stage, the images done and the total.

    Raises
    ------
    ValueError
        If an option is not usable, the only image is not, or no image is.
    OSError
        If a file cannot be written.
    """
    options = options or ViewOptions()
    report = progress or (lambda stage, done, total: None)
    if isinstance(camera, Path):
        camera = central_camera(camera, name=options.name, distance=options.distance)
    options = options.for_camera(camera)
    target, rotations = view_target(options)
    paths = collect_images([str(image) for image in images])
    files = _prepare_output(paths, output, [mask] if mask else [])
    extrapolated = cube_cross([extrapolation_mask(camera, target, rotation) for rotation in rotations])
    source, remappers = camera, list[Remapper]()
    written: list[Path] = []
    errors: list[str] = []
    for i, (path, file) in enumerate(zip(paths, files, strict=True)):
        report("view", i, len(paths))
        try:
            image = read_image(path, apply_exif=options.apply_exif)
            size = image.shape[1], image.shape[0]
            if options.scale_camera and remappers and size != source.size:
                raise ValueError(
                    f"{path.name}: {size[0]}x{size[1]}, others {source.width}x{source.height}: view it apart"
                )
            source = fit_camera(source, size, path.name, scale=options.scale_camera)
            remappers = remappers or [_remapper(source, target, rotation, options) for rotation in rotations]
            result = cube_cross([remap(image) for remap in remappers])
            if options.mark:
                result = hatch(result, extrapolated & cube_cross([r.mask for r in remappers]))
            write_image(file, result)
            written.append(file)
        except ValueError as error:  # one unusable image does not stop the others
            if len(paths) == 1:
                raise
            errors.append(str(error))
    report("view", len(paths), len(paths))
    if not remappers:
        raise ValueError(skipped_message(errors, len(paths)))
    covered = cube_cross([r.mask for r in remappers])
    if mask is not None:
        write_image(mask, covered.astype(np.uint8) * 255)
    if view_camera is not None:
        provenance = {"view": True, "target_from_source": rotations[0].tolist()}
        save(dataclasses.replace(target, provenance=provenance), view_camera)
    return ViewResult(
        options,
        tuple(written),
        source,
        target,
        tuple(rotations),
        image_fraction=sum(visible_fraction(source, target, rotation) for rotation in rotations),
        view_fraction=float(covered.mean()),
        extrapolated_fraction=float((extrapolated & covered).sum() / max(covered.sum(), 1)),
        magnification=magnification(remappers[0]),
        errors=tuple(errors),
    )


def view_target(options: ViewOptions) -> tuple[Camera, list[Array]]:
    """Return the camera of a view and target_from_source: one rotation, or one for each face of a cube."""
    rotation, size, to = options.view_from_source, options.size, options.to or "perspective"
    fov = DEFAULT_FOV_DEG.get(to, 0.0) if options.fov is None else options.fov
    side = min(size) if size else 1024
    if to in PANORAMAS:
        ranges = {"elevation": options.elevation, "azimuth": options.azimuth}
        given: Any = {name: limits for name, limits in ranges.items() if limits is not None}
        return PANORAMAS[to](size[0] if size else 2048, **given), [rotation]
    match to:
        case "perspective":
            return perspective(size or (1280, 720), fov), [rotation]
        case "panini":
            return panini(size or (1280, 720), fov), [rotation]
        case "planet":
            return planet(side, fov), [rotation]
        case "fisheye":
            return fisheye(side, fov, options.projection), [rotation]
        case _:
            return cube_face(side), [cube_rotation(face, rotation) for face in CUBE_FACES]


def hatch(image: NDArray[Any], where: Mask) -> NDArray[Any]:
    """Return the image with bright and dark diagonal lines where a mask (H, W) is set."""
    rows, columns = np.indices(where.shape, np.int32)
    phase = (rows + columns) % HATCH_PERIOD_PX
    hatched = image.copy()
    white = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
    hatched[where & (phase < HATCH_LINE_PX)] = white
    hatched[where & (phase >= HATCH_LINE_PX) & (phase < 2 * HATCH_LINE_PX)] = 0
    return hatched


def skipped_message(errors: Sequence[str], total: int) -> str:
    """Return the message for images that could not be used."""
    return f"{len(errors)} of {total} images were skipped:\n  " + "\n  ".join(errors)


def _prepare_output(images: Sequence[Path], output: Path, others: list[Path]) -> list[Path]:
    """Return the file of each view; check that no image is overwritten, and create the folder."""
    several = len(images) > 1
    if several and output.is_file():
        raise ValueError(f"{output}: is a file; choose a folder for {len(images)} images")
    files = output_paths(images, output) if several or output.is_dir() else [output]
    refuse_overwrite([*files, *others], images)
    if several:
        output.mkdir(parents=True, exist_ok=True)
    return files


def _remapper(source: Camera, target: Camera, rotation: Array, options: ViewOptions) -> Remapper:
    return Remapper(source, target, rotation, interpolation=options.interpolation, antialias=options.antialias)

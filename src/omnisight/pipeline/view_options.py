"""Options of `view`, and the camera and the rotations of a view."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.choices import Options
from omnisight.geometry.rotation import look
from omnisight.views.cube import CUBE_FACES, cube_rotation
from omnisight.views.remapper import Interpolation
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
Range = tuple[float, float]
ViewType = Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"]

PANORAMAS = {"cylinder": cylinder, "mercator": mercator, "sphere": sphere}
DEFAULT_FOV_DEG = {"perspective": 90.0, "panini": 150.0, "planet": 260.0, "fisheye": 180.0}
# Elevation at which the default cylinder of a mirror camera ends: farther up or down it is stretched threefold.
MAX_CYLINDER_ELEVATION_DEG = 60.0


@dataclass(frozen=True)
class ViewOptions(Options):
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
        Interpolation between image pixels: bicubic by default, and bilinear for clips.
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
    interpolation: Interpolation | None = None
    antialias: bool = True
    mark: bool = False
    scale_camera: bool = False
    name: str | None = None
    distance: str | None = None
    apply_exif: bool = False

    def __post_init__(self) -> None:
        """Check that angles are finite and that the field of view is specified in the way of the view type."""
        super().__post_init__()
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

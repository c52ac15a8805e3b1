"""Options of `view`; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from omnisight.choices import Options
from omnisight.display import Displayed

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from omnisight.camera import Camera

Range = tuple[float, float]
ViewType = Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"]

PANORAMA_TYPES = ("cylinder", "mercator", "sphere")
DEFAULT_FOV_DEG = {"perspective": 90.0, "panini": 150.0, "planet": 260.0, "fisheye": 180.0}
# Elevation at which the default cylinder of a mirror camera ends: farther up or down it is stretched threefold.
MAX_CYLINDER_ELEVATION_DEG = 60.0


def has_option(to: ViewType | None, name: str) -> bool:
    """Return whether views of a type have an option; without a type, whether any has."""
    if name == "fov":
        return to is None or to in DEFAULT_FOV_DEG
    return name not in ("elevation", "azimuth") or to is None or to in PANORAMA_TYPES


@dataclass(frozen=True)
class ViewOptions(Options):
    """Options of `view`. Angles are in degrees: +yaw right, +pitch up, +roll clockwise as seen.

    Attributes
    ----------
    to
        Type of the view: perspective by default, and a cylinder for a mirror camera, which is blind along its axis.
    fov
        Field of view, degrees: horizontal for perspective (90), panini (150) and planet (260), diameter for fisheye
        (180).
    yaw
        View direction, positive right.
    pitch
        View direction, positive up; 0 by default, and -90 for a planet.
    roll
        Rotation about the view direction, positive clockwise.
    up
        Where the world's up is: top of the image; back, for a camera that looks down or into a mirror above it; or
        front, for one that looks up. By default back for a mirror camera, top for others.
    flip
        Exchange left and right, for a camera that looks into one mirror.
    size
        (width, height), px; cylinder, mercator and sphere use only the width.
    elevation
        Vertical field of view of a cylinder, mercator or sphere: (low, high), degrees.
    azimuth
        Horizontal field of view of a cylinder, mercator or sphere: (low, high), degrees.
    projection
        Projection of a fisheye.
    interpolation
        Interpolation between image pixels: bicubic by default, and bilinear for clips.
    antialias
        Average image pixels where the view is smaller than the image.
    mark
        Hatch the pixels outside the calibrated field of view, where the camera model extrapolates.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    name
        Name of the camera in a file of several, such as a rig.
    distance
        Scene distance with its unit (2m, or inf), for a non-central camera.
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
    projection: Literal["equidistant", "equisolid", "stereographic", "orthographic"] = "equidistant"
    interpolation: Literal["nearest", "bilinear", "bicubic", "lanczos"] | None = None
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
        for name in ("elevation", "azimuth"):
            if getattr(self, name) is not None and not has_option(self.to, name):
                raise ValueError(f"--{name} applies to cylinder, mercator and sphere; use --fov for a {self.to}")
        if self.fov is not None and not has_option(self.to, "fov"):
            remedy = "its faces are 90 degrees wide" if self.to == "cube" else "use --azimuth"
            raise ValueError(f"--fov does not apply to a {self.to}; {remedy}")

    def for_camera(self, camera: "Camera") -> "ViewOptions":
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
    def view_from_source(self) -> "NDArray[np.float64]":
        """Rotation (3, 3) from the source camera to the view."""
        from omnisight.geometry.rotation import look  # imports numpy

        pitch = (-90.0 if self.to == "planet" else 0.0) if self.pitch is None else self.pitch
        return look(self.yaw, pitch, self.roll, up=self.up or "top", flip=self.flip)


@dataclass(frozen=True, kw_only=True)
class ViewMotion(Displayed):
    """Options of the motion of a view.

    Between keyframes the view moves smoothly, without overshooting; all columns but the time may be missing. `follow`
    is the standard deviation of the Gaussian that smooths the orientation of the camera.

    Attributes
    ----------
    path
        CSV file of keyframes of a moving view: time,yaw,pitch,roll,fov in seconds and degrees.
    pan
        (first, last) yaw, degrees, of a view that turns at constant speed during the clip.
    stabilize
        Poses of the camera (TUM format, such as those of omnisight odometry): the view keeps its direction in the
        world.
    follow
        With --stabilize, follow the camera smoothly over this number of seconds, instead of keeping the direction.
    """

    path: Path | None = None
    pan: tuple[float, float] | None = None
    stabilize: Path | None = None
    follow: float | None = None

    def __post_init__(self) -> None:
        if self.path is not None and self.pan is not None:
            raise ValueError("specify --path or --pan, not both: the keyframes of a path contain the yaw")
        if self.follow is not None and self.stabilize is None:
            raise ValueError("--follow smooths the poses of --stabilize: specify their file too")
        if self.follow is not None and not 0 < self.follow < math.inf:
            raise ValueError(f"--follow is {self.follow:g}; choose a positive number of seconds")

    @property
    def moves(self) -> bool:
        """Whether the view differs from frame to frame."""
        return self.path is not None or self.pan is not None or self.stabilize is not None

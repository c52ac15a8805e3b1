"""Options of `stitch`."""

from dataclasses import dataclass
from pathlib import Path

from omnisight.choices import Options


@dataclass(frozen=True)
class StitchOptions(Options):
    """Options of `stitch`.

    Attributes
    ----------
    width
        Width of the sphere, px, a multiple of 16; by default that of the resolution of the images.
    at
        Distance of the scene with its unit (3m, or inf) for a rig; auto estimates the one with the smallest
        differences in the overlap.
    mask
        Image for each camera, in their order, that is white where pixels are used (in a PBM file: 1); may be repeated.
    level
        Estimate the vertical from lines of the scene, and level the horizon.
    yaw
        Direction of the centre of the sphere, degrees right of the z axis of the rig: without a rig, of the axis of the
        first camera.
    pitch
        Pitch of the rig, degrees, positive up, to level the horizon.
    roll
        Roll of the rig, degrees, positive clockwise.
    heading
        Heading of the centre of the sphere, degrees clockwise from north, for the tags of photos.
    warp
        Warp locally where that reduces the disparity along a seam.
    every
        Frames of a clip or folder between two new estimates of the seam; 0 keeps that of the first frame.
    scale_camera
        Scale the cameras, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation, and frames as the clip specifies for display.
    """

    width: int | None = None
    at: str = "auto"
    mask: tuple[Path, ...] = ()
    level: bool = False
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    heading: float | None = None
    warp: bool = True
    every: int = 0
    scale_camera: bool = False
    apply_exif: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width is not None and not 64 <= self.width <= 32766:
            raise ValueError(f"--width is {self.width}; choose 64 to 32766 px")
        if self.width is not None and self.width % 16:
            raise ValueError(f"--width is {self.width}; choose a multiple of 16, such as {self.width // 16 * 16}")
        if self.every < 0:
            raise ValueError(f"--every is {self.every}; choose a positive number of frames, or 0")
        for name in ("pitch", "roll", "yaw"):
            if not abs(getattr(self, name)) <= 360:
                raise ValueError(f"--{name} is {getattr(self, name):g}; choose -360 to 360 degrees")

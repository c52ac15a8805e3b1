"""Options of `birdseye`; they are those of the command.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass
from pathlib import Path

from omnisight.choices import Options


@dataclass(frozen=True, kw_only=True)
class BirdseyeOptions(Options):
    """Options of `birdseye`. Lengths have a unit: 1cm, 4m.

    Attributes
    ----------
    ground
        JSON file of markings on the ground: pixels with their positions, or a layout of checkerboard squares. The poses
        of the cameras are calibrated to them.
    ground_board
        Image of one camera, with its name, of a calibration board that lies on the ground.
    pattern
        Inner corners of the checkerboard on the ground, columns x rows.
    square
        Side of its squares, such as 40mm.
    target
        File that describes the board on the ground, instead of pattern and square.
    height
        Height of the origin of the rig frame above the ground, such as 1.2m; its y axis points down, apart from pitch
        and roll. Without it and without markings, the rig frame is on the ground.
    pitch
        Angle of the rig's z axis above the horizon, degrees.
    roll
        Rotation of the rig about its z axis, degrees, positive clockwise as seen by the rig.
    pixel
        Side of a pixel on the ground.
    margin
        Ground to show around the vehicle, in each direction.
    vehicle
        Area to leave black: LENGTHxWIDTH, such as 4.5mx1.8m, centred between the cameras; an image of the size of the
        view that is black there; auto, the rectangle that the cameras span; or none.
    blend
        Width of the transition at the seams, on the ground.
    bowl
        Show a bowl instead of the plane: flat up to this distance from the vehicle, and rising as a parabola beyond,
        with a slope of 1 at twice the distance.
    masks
        Folder with images of the names of the cameras, white where pixels are used; others may be missing.
    gain
        Equalize the brightness and colour of the images where they overlap.
    scale_camera
        Scale the cameras, if the images were resized after the calibration.
    apply_exif
        Rotate images by their EXIF orientation, and frames as the clip specifies for display.
    """

    ground: Path | None = None
    ground_board: Path | None = None
    pattern: str | None = None
    square: str | None = None
    target: Path | None = None
    height: str | None = None
    pitch: float = 0.0
    roll: float = 0.0
    pixel: str = "1cm"
    margin: str = "4m"
    vehicle: str = "auto"
    blend: str = "50cm"
    bowl: str | None = None
    masks: Path | None = None
    gain: bool = True
    scale_camera: bool = False
    apply_exif: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if sum(given is not None for given in (self.ground, self.ground_board, self.height)) > 1:
            raise ValueError("specify one of --ground, --ground-board and --height: each determines the ground")
        if self.ground_board is None and (self.pattern or self.square or self.target):
            raise ValueError(
                "--pattern, --square and --target describe a board on the ground: specify its image (--ground-board)"
            )
        if self.height is None and (self.pitch or self.roll):
            raise ValueError("--pitch and --roll are those of a rig at a known height: specify it too (--height)")

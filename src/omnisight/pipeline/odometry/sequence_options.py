"""Options of commands that read a sequence of images.

This module imports nothing heavy, because the command line imports it for its help.
"""

from dataclasses import dataclass

from omnisight.choices import Options


@dataclass(frozen=True, kw_only=True)
class SequenceOptions(Options):
    """How a clip or a folder of images is read.

    Attributes
    ----------
    fps
        Images per second of a folder without times.csv (lines of name,seconds) or images.txt (lines of seconds and
        name). A clip has its own times. By default 10.
    topic
        Image topic of a ROS bag, such as /cam0/image_raw; it may be left out if only one topic has images.
    name
        Name of the camera in a file of several, such as a rig. If the folder has a folder of this name, its images are
        read.
    scale_camera
        Scale the camera to the size of the images, if they were resized.
    apply_exif
        Rotate images by their EXIF orientation, and frames as the clip specifies for display.
    """

    fps: float | None = None
    topic: str | None = None
    name: str | None = None
    scale_camera: bool = False
    apply_exif: bool = False

    def __post_init__(self) -> None:
        """Check the rate."""
        super().__post_init__()
        if self.fps is not None and not 0 < self.fps < float("inf"):
            raise ValueError(f"--fps must be positive, got {self.fps:g}")

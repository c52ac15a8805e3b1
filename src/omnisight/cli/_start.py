"""The camera that a calibration starts from: a lens and its mirror as they were drawn."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omnisight.ray_camera import RayCamera


def drawn(path: Path, model: str) -> "RayCamera":
    """Read the camera of rays to start from.

    Raises
    ------
    ValueError
        If the file holds a central camera, or a model is asked for too.
    """
    from omnisight.camera import Camera
    from omnisight.formats import load

    if model != "auto":
        raise ValueError(f"--start {path} has a model of its own: leave out --model {model}")
    camera = load(path)
    if isinstance(camera, Camera):
        raise ValueError(
            f"{path}: a central camera ({camera.model.name}), which needs no start: leave out --start. It is for a lens"
            " and a mirror whose rays do not meet in a point"
        )
    return camera


def must_fit(camera: "RayCamera", path: Path | None, size: tuple[int, int], unit: str) -> None:
    """Refuse a camera to start from that is for other images, or in another unit than the board."""
    if all(camera.size) and camera.size != size:
        raise ValueError(f"{path}: for images of {camera.width}x{camera.height}; these are {size[0]}x{size[1]}")
    if camera.unit != unit:
        metres = camera.unit == "m"
        what = "give the side of a square, such as --square 30mm" if metres else "leave out --square"
        raise ValueError(
            f"{path}: its lengths are in {'metres' if metres else camera.unit}, the board's are not: {what}"
        )

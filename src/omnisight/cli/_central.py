"""The central camera of a file: its own, or that of a camera of rays for one distance."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omnisight.camera import Camera

# What a central camera may be off, px, at the distance that it is for.
FARTHEST_OFF = 1.0


def central_camera(path: Path, *, name: str | None = None, distance: str | None = None, takes: bool = True) -> "Camera":
    """Read a central camera from a file of any format.

    Parameters
    ----------
    path
        The file.
    name
        Which camera, where it holds several.
    distance
        How far what a camera of rays looks at is, with its unit.
    takes
        Whether the command can be told a distance.

    Raises
    ------
    ValueError
        If it holds a camera of rays and there is no distance, or the distance cannot be read.
    """
    from omnisight.camera import Camera
    from omnisight.formats import load

    source = load(path, name=name)
    where = f"{path}, {name}" if name else str(path)
    if isinstance(source, Camera):
        if distance is not None:
            raise ValueError(f"--distance is for cameras whose rays do not meet; those of {where} do: leave it out")
        return source
    said = f"{where}: a camera whose rays do not meet in a point ({source.model.name})"
    if not takes:
        raise ValueError(f"{said}, which this command does not take: give the central one, of --model auto")
    if distance is None:
        such = "2m" if source.unit == "m" else "20squares"
        raise ValueError(
            f"{said}: say how far away what it looks at is, as --distance {such}; the central camera that fits there is"
            " taken"
        )
    away = _length(distance, source.unit)
    central, error = source.central(away)
    if not error <= FARTHEST_OFF:
        central, error = source.central(away, "spline")
    if not error <= FARTHEST_OFF:
        raise ValueError(
            f"{said}: at {distance} no central camera comes nearer than {error:.2g} px, {FARTHEST_OFF:g} allowed: give"
            " a larger distance, or inf"
        )
    return central


def _length(text: str, unit: str) -> float:
    """Read a distance in the unit of a camera; "inf" is far."""
    from omnisight.targets.length import parse_length

    if text.strip().lower() in ("inf", "far"):
        return float("inf")
    if unit == "m":
        return parse_length(text)
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(squares?)?\s*", text)
    if match is None or not float(match[1]) > 0:
        raise ValueError(f"--distance {text}: this camera's lengths are in squares of its board: 20squares")
    return float(match[1])

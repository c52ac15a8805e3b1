"""omnisight view."""

import dataclasses
import math
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from omnisight.cli._progress import progress
from omnisight.cli._size import parse_range, parse_size

View = Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"]
# A range begins with a minus more often than not.
Angles = Annotated[str | None, Parameter(allow_leading_hyphen=True)]

# What is extrapolation_mask is hatched with lines this far apart, px along a row.
HATCH_PX = 16


def view(
    pictures: list[str],
    /,
    *,
    camera: Path,
    to: View = "perspective",
    output: Annotated[Path, Parameter(alias="-o")],
    fov: float | None = None,
    yaw: float = 0.0,
    pitch: float | None = None,
    roll: float = 0.0,
    up: Literal["top", "back", "front"] = "top",
    flip: bool = False,
    size: str | None = None,
    elevation: Angles = None,
    azimuth: Angles = None,
    projection: Literal["equidistant", "equisolid", "stereographic", "orthographic"] = "equidistant",
    interpolation: Literal["nearest", "bilinear", "bicubic", "lanczos"] = "bicubic",
    antialias: bool = True,
    mask: Path | None = None,
    mark: bool = False,
    view_camera: Path | None = None,
    scale_camera: bool = False,
    name: str | None = None,
    distance: str | None = None,
    apply_exif: bool = False,
    quiet: bool = False,
) -> None:
    """Turn images into views: perspective, cylinder, sphere, cube, planet, fisheye ...

    Angles are in degrees. +yaw looks right, +pitch up, +roll turns the view clockwise:

                 y up is -v         x right, y down, z forward is the camera;
                  |  / forward      yaw 0, pitch 0 is its axis.
                  | /
        left -----+----- right (+yaw)

    Parameters
    ----------
    images
        An image, or folders, files and patterns: several images go to the folder --output.
    camera
        The calibration file of the camera that took them, of any format.
    to
        What to show.
    output
        The view's file, or a folder, which several images need.
    fov
        Field of view, degrees: across for perspective (90), panini (150) and planet (260), rim to rim for fisheye
        (180).
    yaw, roll
        Where to look.
    pitch
        Where to look; 0, and -90 for a planet.
    up
        Where the world's up is: the image's top; back, for a camera that looks down or into a mirror above it; or
        front, for one that looks up.
    flip
        Exchange left and right: for a camera that looks into one mirror.
    size
        WIDTHxHEIGHT in px; for cylinder, mercator and sphere the width alone counts.
    elevation, azimuth
        LOW:HIGH in degrees, what a cylinder, mercator or sphere shows.
    projection
        Of a fisheye.
    interpolation
        Between the image's pixels.
    antialias
        Average pixels where the view is smaller than the image.
    mask
        Write which pixels of the view the image shows: a PNG, 255 where it does.
    mark
        Hatch what lies where the camera was not calibrated: there it extrapolates.
    view_camera
        Write the view's own camera, whose rotation is in its provenance.
    scale_camera
        The images were resized since the calibration: scale the camera to them.
    name
        Which camera, where the file holds several, as that of a rig does.
    distance
        Of a camera whose rays do not meet in a point: how far what it looks at is, with its unit (2m, or inf).
    apply_exif
        Turn images as their EXIF orientation says.
    quiet
        Show no progress.
    """
    import numpy as np

    from omnisight.cli._central import central_camera
    from omnisight.formats import save
    from omnisight.images import collect_images, read_image, write_image
    from omnisight.images.output_paths import output_paths, refuse_overwrite
    from omnisight.views.maps import extrapolation_mask
    from omnisight.views.remapper import Remapper

    source = central_camera(camera, name=name, distance=distance)
    target, rotations = _target(to, fov, size, elevation, azimuth, projection, (yaw, pitch, roll), up, flip)
    paths = collect_images(pictures)
    several = len(paths) > 1
    if several and output.is_file():
        raise ValueError(f"{output}: is a file; {len(paths)} images go to a folder")
    files = output_paths(paths, output) if several or output.is_dir() else [output]
    refuse_overwrite([*files, *([mask] if mask else [])], paths)
    if several:
        output.mkdir(parents=True, exist_ok=True)
    options: Any = {"interpolation": interpolation, "antialias": antialias}
    remappers: list[Remapper] = []
    past = _cube_sheet([extrapolation_mask(source, target, rotation) for rotation in rotations])
    left_out: list[str] = []
    with progress(quiet) as report:
        for i, (path, file) in enumerate(zip(paths, files, strict=True)):
            report("view", i, len(paths))
            try:
                image = read_image(path, apply_exif=apply_exif)
                if not remappers:
                    source = _fitting(source, (image.shape[1], image.shape[0]), path, scale_camera)
                    remappers = [Remapper(source, target, rotation, **options) for rotation in rotations]
                _fitting(source, (image.shape[1], image.shape[0]), path, False)
                shot = _cube_sheet([remap(image) for remap in remappers])
                write_image(file, _hatched(shot, past & _cube_sheet([r.mask for r in remappers])) if mark else shot)
            except ValueError as error:  # one bad image does not stop the others
                if not several:
                    raise
                left_out.append(str(error))
        report("view", len(paths), len(paths))
    lost = f"{len(left_out)} of {len(paths)} images were left out:\n  " + "\n  ".join(left_out)
    if not remappers:
        raise ValueError(lost)
    shown = _cube_sheet([r.mask.astype(np.uint8) * 255 for r in remappers])
    if mask is not None:
        write_image(mask, shown)
    if view_camera is not None:
        _save_view_camera(save, target, rotations[0], view_camera)
    _tell(source, target, rotations, remappers, (shown > 0).mean(), output if several else files[0], up)
    _warn(source, float((past & (shown > 0)).sum() / max((shown > 0).sum(), 1)), mark)
    if left_out:
        raise ValueError(lost)


def _target(
    to: View,
    fov: float | None,
    size: str | None,
    elevation: str | None,
    azimuth: str | None,
    projection: str,
    angles: tuple[float, float | None, float],
    up: str,
    flip: bool,
) -> tuple[Any, list[Any]]:
    """Give the view's camera and target_from_source of each of its parts."""
    import omnisight as om
    from omnisight.views.view_cameras import CUBE_FACES, cube_rotation

    yaw, pitch, roll = angles
    for name, angle in (("yaw", yaw), ("pitch", pitch or 0.0), ("roll", roll)):
        if not math.isfinite(angle):
            raise ValueError(f"--{name} must be a number of degrees, got {angle}")
    rotation = om.look(yaw, (-90.0 if to == "planet" else 0.0) if pitch is None else pitch, roll, up=up, flip=flip)
    wanted = parse_size(size) if size else None
    ranges = {
        name: parse_range(text, f"--{name}") for name, text in (("elevation", elevation), ("azimuth", azimuth)) if text
    }
    if ranges and to not in ("cylinder", "mercator", "sphere"):
        raise ValueError(f"--{next(iter(ranges))} is for cylinder, mercator and sphere; a {to} takes --fov")
    if fov is not None and to in ("cylinder", "mercator", "sphere", "cube"):
        raise ValueError(
            f"--fov is not for a {to}; " + ("its faces are 90 degrees" if to == "cube" else "use --azimuth")
        )
    wide: Any = {"width": wanted[0] if wanted else 2048, **ranges}
    side = min(wanted) if wanted else 1024
    match to:
        case "perspective":
            return om.perspective(90.0 if fov is None else fov, wanted or (1280, 720)), [rotation]
        case "panini":
            return om.panini(150.0 if fov is None else fov, wanted or (1280, 720)), [rotation]
        case "cylinder":
            return om.cylinder(**wide), [rotation]
        case "mercator":
            return om.mercator(**wide), [rotation]
        case "sphere":
            return om.sphere(**wide), [rotation]
        case "planet":
            return om.planet(side, 260.0 if fov is None else fov), [rotation]
        case "fisheye":
            return om.fisheye(side, 180.0 if fov is None else fov, projection), [rotation]
        case "cube":
            return om.cube_face(side), [cube_rotation(face, rotation) for face in CUBE_FACES]


def _cube_sheet(faces: list[Any]) -> Any:
    """Join six faces into a cross: up; left, front, right, back; down. A single view stays as it is."""
    import numpy as np

    if len(faces) == 1:
        return faces[0]
    front, right, back, left, above, below = faces
    side = front.shape[0]
    sheet = np.zeros((3 * side, 4 * side, *front.shape[2:]), front.dtype)
    for image, row, column in (
        *((above, 0, 1), (left, 1, 0), (front, 1, 1)),
        *((right, 1, 2), (back, 1, 3), (below, 2, 1)),
    ):
        sheet[row * side : (row + 1) * side, column * side : (column + 1) * side] = image
    return sheet


def _hatched(image: Any, past: Any) -> Any:
    """Draw dark and bright diagonals where the camera extrapolates."""
    import numpy as np

    rows, columns = np.indices(past.shape, np.int32)
    phase = (rows + columns) % HATCH_PX
    marked = image.copy()
    top = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
    marked[past & (phase < 2)] = top
    marked[past & (phase >= 2) & (phase < 4)] = 0
    return marked


def _fitting(source: Any, size: tuple[int, int], picture: Path, scale: bool) -> Any:
    """Give the camera for images of this size, scaled if asked to, or refuse the image."""
    from omnisight.views.remapper import size_mismatch

    if min(source.size) < 1:  # its file does not say: the images do
        return dataclasses.replace(source, size=size)
    scaled = source.scaled(size[0] / source.width) if scale else source
    if scaled.width != size[0] or abs(scaled.height - size[1]) > scale:
        raise ValueError(f"{picture.name}: {size_mismatch(size, source.size)}")
    return dataclasses.replace(scaled, size=size)


def _save_view_camera(save: Any, target: Any, rotation: Any, path: Path) -> None:
    provenance = {"view": True, "target_from_source": rotation.tolist()}
    save(dataclasses.replace(target, provenance=provenance), path)


def _warn(source: Any, share: float, marked: bool) -> None:
    """Say how much of a view is extrapolation_mask, and what the calibration thinks of itself."""
    if share > 0.005:
        inner = f"within {math.degrees(source.theta_min):.0f} or " if source.theta_min else ""
        where = f"{inner}past {math.degrees(source.theta_max):.0f} degrees"
        hint = "" if marked else "; --mark hatches it"
        print(f"{share:.0%} of what is shown lies {where}, where the camera extrapolates{hint}")
    if source.calibration.get("verdict") == "do not use":
        reasons = source.calibration.get("reasons")
        told = isinstance(reasons, list) and reasons and isinstance(reasons[0], str)
        print(f"this calibration's own verdict is: do not use. {reasons[0] if told else 'See omnisight inspect.'}")


def _tell(
    source: Any, target: Any, rotations: list[Any], remappers: list[Any], covered: float, output: Path, up: str
) -> None:
    from omnisight.views.maps import visible_fraction
    from omnisight.views.remapper import magnification

    kept = sum(visible_fraction(source, target, rotation) for rotation in rotations)
    centre, rim = magnification(remappers[0])
    print(f"written: {output} ({target.width}x{target.height}{', six faces' if len(rotations) > 1 else ''})")
    print(f"{kept:.0%} of the image is shown, and fills {covered:.0%} of the view")
    print(f"a pixel of the image is {centre:.2f} px wide in the middle of the view, {rim:.2f} px at its rim")
    if up == "top" and target.model.name in ("cylindrical", "mercator", "equirectangular") and covered < 0.75:
        print("the camera was taken to stand upright; if it looks down, up or into a mirror: --up back|front, --flip")

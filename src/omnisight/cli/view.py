"""omnisight view."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from omnisight.cli._progress import progress
from omnisight.cli._size import parse_range, parse_size

if TYPE_CHECKING:
    from omnisight.pipeline.view import ViewResult

GROUP = "Views"

# A range usually starts with a minus sign.
Angles = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
# Warn if more than this share of the view is outside the calibrated field of view.
MAX_EXTRAPOLATED_FRACTION = 0.005


def view(
    images: list[str],
    /,
    *,
    camera: Path,
    to: Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"] | None = None,
    output: Annotated[Path, Parameter(alias="-o")],
    fov: float | None = None,
    yaw: float = 0.0,
    pitch: float | None = None,
    roll: float = 0.0,
    up: Literal["top", "back", "front"] | None = None,
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

    Angles are in degrees. +yaw looks right, +pitch up, +roll rotates the view clockwise:

                 y up is -v         x right, y down, z forward is the camera;
                  |  / forward      yaw 0, pitch 0 is its axis.
                  | /
        left -----+----- right (+yaw)

    Parameters
    ----------
    images
        Images, folders or patterns. Several images go to the folder --output.
    camera
        Calibration file of any format.
    to
        Type of the view: perspective by default, and a cylinder for a mirror camera, which is blind along its axis.
    output
        File of the view, or a folder (required for several images).
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
        WIDTHxHEIGHT, px; cylinder, mercator and sphere use only the width.
    elevation
        Vertical field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    azimuth
        Horizontal field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    projection
        Projection of a fisheye.
    interpolation
        Interpolation between image pixels.
    antialias
        Average image pixels where the view is smaller than the image.
    mask
        Write the mask of covered pixels: a PNG, 255 where the image covers the view.
    mark
        Hatch the pixels outside the calibrated field of view, where the camera model extrapolates.
    view_camera
        Write the camera of the view; its provenance has the rotation.
    scale_camera
        Scale the camera, if the images were resized after the calibration.
    name
        Name of the camera in a file of several, such as a rig.
    distance
        Scene distance with its unit (2m, or inf), for a non-central camera.
    apply_exif
        Rotate images by their EXIF orientation.
    quiet
        Show no progress.
    """
    from omnisight.pipeline.view import ViewOptions, skipped_message
    from omnisight.pipeline.view import view as write_views

    options = ViewOptions(
        to=to,
        fov=fov,
        yaw=yaw,
        pitch=pitch,
        roll=roll,
        up=up,
        flip=flip,
        size=parse_size(size) if size else None,
        elevation=parse_range(elevation, "--elevation") if elevation else None,
        azimuth=parse_range(azimuth, "--azimuth") if azimuth else None,
        projection=projection,
        interpolation=interpolation,
        antialias=antialias,
        mark=mark,
        scale_camera=scale_camera,
        name=name,
        distance=distance,
        apply_exif=apply_exif,
    )
    with progress(quiet) as report:
        result = write_views(images, camera, output, options, mask=mask, view_camera=view_camera, progress=report)
    count = len(result.files) + len(result.errors)
    _print_result(result, is_up_given=up is not None, written=output if count > 1 else result.files[0])
    if result.errors:
        raise ValueError(skipped_message(result.errors, count))


def _print_result(result: "ViewResult", *, is_up_given: bool, written: Path) -> None:
    """Print the coverage, the magnification, warnings, and the file or folder written."""
    import math

    source, target, options = result.source, result.target, result.options
    faces = ", six faces" if len(result.rotations) > 1 else ""
    centre, edge = result.magnification
    print(f"view      {options.to}, {target.width}x{target.height}{faces}")
    covered = f"{result.view_fraction:.0%} of the view is covered"
    print(f"coverage  {result.image_fraction:.0%} of the image is visible, {covered}")
    print(f"scale     1 px of the image is {centre:.2f} px wide in the centre of the view, {edge:.2f} px at its edge")
    if result.extrapolated_fraction > MAX_EXTRAPOLATED_FRACTION:
        inner = f"within {math.degrees(source.theta_min):.0f} or " if source.theta_min else ""
        limit = f"{inner}beyond {math.degrees(source.theta_max or 0.0):.0f} degrees"
        hint = "" if options.mark else "; --mark hatches it"
        share = f"{result.extrapolated_fraction:.0%} of the view"
        print(f"warning   {share} is {limit}, outside the calibrated field of view{hint}")
    if source.calibration.get("verdict") == "do not use":
        reasons = source.calibration.get("reasons")
        reason = "See omnisight inspect."
        if isinstance(reasons, list) and reasons and isinstance(reasons[0], str):
            reason = reasons[0]
        print(f"warning   the verdict of this calibration is: do not use. {reason}")
    if source.theta_min and not is_up_given:
        blind = f"it is blind within {math.degrees(source.theta_min):.0f} degrees of its axis"
        print(f"hint      a mirror camera ({blind}): --up back is assumed; if text is mirrored: --flip")
    upright = options.up == "top" and options.to in ("cylinder", "mercator", "sphere")
    if upright and result.view_fraction < 0.75:
        print("hint      the camera is assumed upright; if it looks down, up or into a mirror: --up back|front, --flip")
    print(f"written   {written}")

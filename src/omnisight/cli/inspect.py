"""omnisight inspect."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from omnisight.cli._output import is_json, is_verbose, write_json
from omnisight.display import rounded

if TYPE_CHECKING:
    from omnisight.camera import Camera
    from omnisight.pipeline.conversion.inspect import CameraDescription
    from omnisight.ray_camera import RayCamera
    from omnisight.rig import Rig

GROUP = "Cameras"

# A spline camera has hundreds of parameters; the first ones are printed without --verbose.
MAX_LISTED_PARAMETERS = 16
MAX_VALUE_CHARS = 90


def inspect(
    camera: Path,
    /,
    *,
    name: str | None = None,
    svg: Path | None = None,
    images: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)] = (),
) -> None:
    """Print what a calibration file holds: model, image size, field of view, focal length, conventions, r(theta).

    Of a rig, it also prints the poses and the overlap of the cameras. The object of --json has the cameras as
    omnisight's own JSON by name, is omnisight's own JSON of a rig or, with --images, the check of the extrinsics.

    Parameters
    ----------
    camera
        A calibration file of any format.
    name
        The camera to print if the file holds several; by default all of them.
    svg
        Draw r(theta) of one camera into this file.
    images
        Of a rig: a simultaneous image of each camera, in the order of the cameras. Their matches show whether the
        extrinsics are inverted.
    """
    from omnisight.pipeline.conversion.inspect import inspect as inspect_file

    if svg is not None:
        from omnisight.cli._files import must_be_writable, refuse_inputs

        must_be_writable(svg)
        refuse_inputs(svg, camera, *images)
    if images:
        if name is not None or svg is not None:
            raise ValueError("--images checks the extrinsics of a whole rig: leave out --name and --svg")
        _check_images(camera, images)
        return
    descriptions = inspect_file(camera, name=name)
    if svg is not None and len(descriptions) > 1:
        names = ", ".join(descriptions)
        raise ValueError(f"--svg draws one camera, and {camera} holds {names}: specify one of them by --name")
    rig = _rig(camera) if name is None and len(descriptions) > 1 else None
    if is_json():
        from omnisight.formats.native import rig_to_json, to_json

        cameras = {key: to_json(value.camera) for key, value in descriptions.items()}
        write_json(cameras if rig is None or isinstance(rig, str) else rig_to_json(rig))
    else:
        _print_descriptions(descriptions, camera, rig)
    if svg is not None:
        profile = next(iter(descriptions.values())).profile
        if profile is None:
            raise ValueError(f"{camera}: a non-central camera without a lens has no r(theta) to draw")
        if not len(profile.theta_deg):
            raise ValueError(f"{camera}: the optical axis is outside of the image: there is no r(theta) to draw")
        from omnisight.images import write_bytes
        from omnisight.report.drawings.radial_profile import profile_svg

        write_bytes(svg, profile_svg(profile).encode())
        print(f"written: {svg}")


def _rig(path: Path) -> "Rig | str":
    """Return the rig of a file of several cameras, or the reason why their poses are not read."""
    from omnisight.formats import load_rig

    try:
        return load_rig(path)
    except ValueError as error:
        return str(error)


def _print_descriptions(descriptions: "dict[str, CameraDescription]", path: Path, rig: "Rig | str | None") -> None:
    """Print the cameras of a file, and their poses."""
    from omnisight.cli._inspect_rig_report import print_rig

    for key, description in descriptions.items():
        if len(descriptions) > 1:
            print(f"== {key}")
        _print_description(description, path)
    if isinstance(rig, str):
        print(f"== poses not read: {rig}")
    elif rig is not None:
        print_rig(rig)


def _check_images(path: Path, images: tuple[Path, ...]) -> None:
    """Check the extrinsics of a rig by images, and print the result."""
    from omnisight.cli._inspect_rig_report import check_data, print_check, print_rig
    from omnisight.formats import load_rig
    from omnisight.pipeline.rig_calibration.check_extrinsics import check_extrinsics

    rig = load_rig(path)
    check = check_extrinsics(rig, images)
    if is_json():
        write_json(check_data(check))
        return
    print_rig(rig)
    print_check(check, path)


def _print_description(description: "CameraDescription", path: Path) -> None:
    from omnisight.ray_camera import RayCamera

    camera = description.camera
    print(f"file        {path.name}: {description.format_title}")
    print(f"model       {camera.model.name}: {description.model_title}")
    _print_parameters(description)
    print(f"size        {camera.width} x {camera.height} px" if camera.width else "size        not in the file")
    if isinstance(camera, RayCamera):
        _print_non_central(camera, description.pupil_shift)
    if description.profile is not None:
        _print_projection(description)
    for key, value in camera.calibration.items():
        _print_figure(key, value)
    print("convention  x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0)")
    print(f"its file    {description.convention}")
    for label, values in (("from", camera.provenance), ("also", camera.extra)):
        for key, value in values.items():
            text = str(value)
            text = text if len(text) < MAX_VALUE_CHARS else text[: MAX_VALUE_CHARS - 3] + "..."
            print(f"{label:<11} {key}: {text}")
    if description.profile is not None:
        from omnisight.report.drawings.radial_profile import profile_text

        print()
        print(profile_text(description.profile))


def _print_parameters(description: "CameraDescription") -> None:
    listed = description.parameters if is_verbose() else description.parameters[:MAX_LISTED_PARAMETERS]
    width = max(8, *(len(parameter.name) for parameter in listed))
    for p in listed:
        sigma = "" if p.sigma is None else f" +- {rounded(p.sigma)}" if p.sigma else " (fixed)"
        print(f"  {p.name:<{width}} {p.value:14.8g}{sigma:<12} {p.unit:<3} {p.description}")
    if len(description.parameters) > len(listed):
        more, last = len(description.parameters) - len(listed), description.parameters[-1].name
        print(f"  ... and {more} more, to {last} (--verbose)")


def _print_non_central(camera: "RayCamera", pupil_shift: float | None) -> None:
    import math

    print("rays        non-central: the pixel of a point depends on its distance")
    print(f"lengths     in {'metres' if camera.unit == 'm' else camera.unit}")
    if pupil_shift is not None:
        shift = (
            f"{rounded(1e3 * pupil_shift, 3)} mm" if camera.unit == "m" else f"{rounded(pupil_shift, 3)} {camera.unit}"
        )
        first, last = math.degrees(camera.theta_min), math.degrees(camera.theta_max or camera.model.theta_max)
        print(f"pupil       shifts by {shift} along the axis from {first:.0f} to {last:.0f} degrees")
    print("central     approximation at a distance: omnisight convert --distance, view --distance")


def _print_projection(description: "CameraDescription") -> None:
    """Print field of view, focal length, principal point and valid angles of a central camera."""
    import math

    from omnisight.pipeline.conversion.inspect import extrapolated_beyond_deg

    camera, profile = description.camera, description.profile
    assert profile is not None
    if description.field_deg is not None:
        angles = [f"{angle:.1f} deg" if angle is not None else "beyond the model" for angle in description.field_deg]
        limit = extrapolated_beyond_deg(camera, description.field_deg)
        note = "" if limit is None else f", extrapolated beyond {limit:.1f} deg"
        print(f"field       {angles[0]} horizontal, {angles[1]} vertical, {angles[2]} diagonal{note}")
    print(f"focal       {profile.focal:.2f} px per radian on the axis")
    (u, v), (width, height) = profile.centre, camera.size
    offset = f", {u - (width - 1) / 2:+.1f}, {v - (height - 1) / 2:+.1f} px from the image centre" if width else ""
    print(f"centre      ({u:.2f}, {v:.2f}){offset}")
    limit = math.degrees(_lens_theta_max(camera))
    print(f"valid       to {limit:.1f} degrees from the axis" + ("" if limit >= 179.9 else ", where the model ends"))
    if camera.theta_max is not None:
        start = f"from {math.degrees(camera.theta_min):.1f} " if camera.theta_min else ""
        print(f"calibrated  {start}to {math.degrees(camera.theta_max):.1f} degrees from the axis; extrapolated beyond")


def _lens_theta_max(camera: "Camera | RayCamera") -> float:
    """Return the largest valid angle from the axis (radians) of a central camera or of an axial camera's lens."""
    lens: Any = getattr(camera.model, "lens", camera.model)
    return lens.theta_max


def _print_figure(key: str, value: Any) -> None:
    """Print a calibration figure: a list of sentences line by line, nested figures on one line."""
    if isinstance(value, list) and value and all(isinstance(entry, str) for entry in value):
        for i, entry in enumerate(value):
            print(f"  {key if i == 0 else '':<14} {entry}")
    elif isinstance(value, dict):
        entries = ", ".join(f"{name} {_short(entry)}" for name, entry in value.items() if not isinstance(entry, list))
        print(f"  {key:<14} {entries}")
    elif isinstance(value, list):
        if value:
            print(f"  {key:<14} {', '.join(map(_short, value))}")
    elif value is not None:
        print(f"  {key:<14} {_short(value)}")


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)

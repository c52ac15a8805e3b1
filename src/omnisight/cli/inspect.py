"""omnisight inspect."""

from pathlib import Path
from typing import Any

# A generic camera has hundreds of parameters; so many are printed.
MOST_PARAMETERS = 16


def inspect(camera: Path, /, *, name: str | None = None, svg: Path | None = None, json: bool = False) -> None:
    """Say what a calibration file holds: model, size, field of view, focal length, centre, conventions, r(theta).

    Parameters
    ----------
    camera
        A calibration file of any format.
    name
        Which camera, where the file holds several; all of them unless told otherwise.
    svg
        Draw r(theta) into this file.
    json
        Print the camera as omnisight's own JSON, one object by name.
    """
    from omnisight.formats import load_all

    cameras = load_all(camera)
    if name is not None:
        if name not in cameras:
            raise ValueError(f"{camera}: no camera {name!r}; it holds {', '.join(cameras)}")
        cameras = {name: cameras[name]}
    if json:
        import json as text

        from omnisight.formats.native import to_json

        print(text.dumps({key: to_json(value) for key, value in cameras.items()}, indent=2))
        return
    for key, value in cameras.items():
        if len(cameras) > 1:
            print(f"== {key}")
        _describe(value, camera)
    if svg is not None:
        shown = _as_seen(next(iter(cameras.values())))
        if shown is None:
            raise ValueError(f"{camera}: a camera of rays without a lens of its own has no r(theta) to draw")
        from omnisight.images import write_bytes
        from omnisight.report.drawings.radial_profile import radial_profile, to_svg

        write_bytes(svg, to_svg(radial_profile(shown)).encode())
        print(f"written: {svg}")


def _describe(camera: Any, path: Path) -> None:
    from omnisight.formats import format_names, get_format
    from omnisight.ray_camera import RayCamera

    model = camera.model
    source = camera.provenance.get("format", "native")
    source = source if source in format_names() else "native"
    print(f"file        {path.name}: {get_format(source).TITLE}")
    print(f"model       {model.name}: {(type(model).__doc__ or '').strip().splitlines()[0]}")
    _parameters(camera)
    print(f"size        {camera.width} x {camera.height} px" if camera.width else "size        not in the file")
    if isinstance(camera, RayCamera):
        _viewpoint(camera)
    central = _as_seen(camera)
    curve = "" if central is None else _picture(central)
    for key, value in camera.calibration.items():
        _tell(key, value)
    print("convention  x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0)")
    print(f"its file    {get_format(source).CONVENTION}")
    for key, value in camera.provenance.items():
        text = str(value)
        print(f"from        {key}: {text if len(text) < 90 else text[:87] + '...'}")
    for key, value in camera.extra.items():
        text = str(value)
        print(f"also        {key}: {text if len(text) < 90 else text[:87] + '...'}")
    if curve:
        print()
        print(curve)


def _parameters(camera: Any) -> None:
    import numpy as np

    model = camera.model
    told = list(zip(model.parameters, model.params, strict=True))
    wide = max(8, *(len(parameter.name) for parameter, _ in told[:MOST_PARAMETERS]))
    for parameter, value in told[:MOST_PARAMETERS]:
        sigma = ""
        if camera.covariance is not None:
            index = model.param_names.index(parameter.name)
            deviation = float(np.sqrt(max(camera.covariance[index, index], 0)))
            sigma = f" +- {deviation:.2g}" if deviation else " (fixed)"
        unit = getattr(camera, "unit", "m") if parameter.unit == "m" else parameter.unit
        print(f"  {parameter.name:<{wide}} {value:14.8g}{sigma:<12} {unit:<3} {parameter.doc}")
    if len(told) > MOST_PARAMETERS:
        print(f"  ... and {len(told) - MOST_PARAMETERS} more, to {told[-1][0].name}")


def _as_seen(camera: Any) -> Any:
    """Give the central camera that r(theta) is drawn of: the lens of one whose viewpoint moves along its axis."""
    from omnisight.camera import Camera
    from omnisight.optics.models.axial import Axial

    if isinstance(camera, Camera):
        return camera
    if not isinstance(camera.model, Axial):
        return None
    return Camera(camera.model.lens, camera.size, theta_max=camera.theta_max, theta_min=camera.theta_min)


def _viewpoint(camera: Any) -> None:
    import math

    from omnisight.optics.models.axial import Axial

    print("rays        do not meet in a point: the distance of what is seen matters")
    print(f"lengths     in {'metres' if camera.unit == 'm' else camera.unit}")
    if isinstance(camera.model, Axial):
        first, last = camera.theta_min, camera.theta_max or camera.model.theta_max
        travel = camera.model.pupil_shift(first, last)
        said = f"{1e3 * travel:.3g} mm" if camera.unit == "m" else f"{travel:.3g} {camera.unit}"
        print(
            f"viewpoint   moves by {said} along the axis, {math.degrees(first):.0f} to {math.degrees(last):.0f} degrees"
        )
    print("central     what fits at a distance: omnisight convert --distance, view --distance")


def _picture(camera: Any) -> str:
    """Say how a central camera shows the world, and give its curve r(theta)."""
    import numpy as np

    from omnisight.report.drawings.radial_profile import radial_profile, to_text

    model = camera.model
    if camera.width:
        h, v, d = _fields(camera)
        print(f"field       {h} across, {v} down, {d} corner to corner")
    profile = radial_profile(camera)
    centre = profile.centre
    print(f"focal       {profile.focal:.2f} px per radian on the axis")
    offset = np.array(centre) - (np.array(camera.size) - 1) / 2
    print(
        f"centre      ({centre[0]:.2f}, {centre[1]:.2f}), {offset[0]:+.1f}, {offset[1]:+.1f} px from the image's middle"
    )
    limit = np.degrees(model.theta_max)
    print(
        f"valid       to {limit:.1f} degrees from the axis"
        + ("" if limit >= 179.9 else ", where the model ends or folds over")
    )
    if camera.theta_max is not None:
        inner = f"from {np.degrees(camera.theta_min):.1f} " if camera.theta_min else ""
        print(f"calibrated  {inner}to {np.degrees(camera.theta_max):.1f} degrees from the axis; extrapolated past it")
    return to_text(profile)


def _tell(key: str, value: Any) -> None:
    """Print one figure of the calibration: sentences each on a line, figures of figures in short."""
    if isinstance(value, list) and value and all(isinstance(entry, str) for entry in value):
        for i, entry in enumerate(value):
            print(f"  {key if i == 0 else '':<14} {entry}")
    elif isinstance(value, dict):
        named = ", ".join(f"{name} {_short(entry)}" for name, entry in value.items() if not isinstance(entry, list))
        print(f"  {key:<14} {named}")
    elif isinstance(value, list):
        if value:
            print(f"  {key:<14} {', '.join(map(_short, value))}")
    elif value is not None:
        print(f"  {key:<14} {_short(value)}")


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _fields(camera: Any) -> tuple[str, str, str]:
    """Give the angles between opposite edges and corners of the image, through its centre."""
    import numpy as np

    from omnisight.report.drawings.radial_profile import radial_profile

    u0, v0 = radial_profile(camera).centre
    w, h = camera.width - 0.5, camera.height - 0.5
    pairs = (((-0.5, v0), (w, v0)), ((u0, -0.5), (u0, h)), ((-0.5, -0.5), (w, h)))
    found: list[str] = []
    for pair in pairs:
        angles = np.degrees(camera.angle_of(np.array(pair)))
        found.append(f"{angles.sum():.1f} deg" if np.isfinite(angles).all() else "past the model's end")
    return found[0], found[1], found[2]

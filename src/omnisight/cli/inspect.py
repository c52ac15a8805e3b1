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
        from omnisight.cli._profile import radial_profile, to_svg
        from omnisight.images import write_bytes

        write_bytes(svg, to_svg(radial_profile(next(iter(cameras.values())))).encode())
        print(f"written: {svg}")


def _describe(camera: Any, path: Path) -> None:
    import numpy as np

    from omnisight.cli._profile import radial_profile, to_text
    from omnisight.formats import format_named, format_names

    model = camera.model
    source = camera.provenance.get("format", "native")
    source = source if source in format_names() else "native"
    print(f"file        {path.name}: {format_named(source).TITLE}")
    print(f"model       {model.name}: {(type(model).__doc__ or '').strip().splitlines()[0]}")
    told = list(zip(model.parameters, model.params, strict=True))
    for parameter, value in told[:MOST_PARAMETERS]:
        sigma = ""
        if camera.covariance is not None:
            index = model.param_names.index(parameter.name)
            deviation = float(np.sqrt(max(camera.covariance[index, index], 0)))
            sigma = f" +- {deviation:.2g}" if deviation else " (fixed)"
        print(f"  {parameter.name:<8} {value:14.8g}{sigma:<12} {parameter.unit:<3} {parameter.doc}")
    if len(told) > MOST_PARAMETERS:
        print(f"  ... and {len(told) - MOST_PARAMETERS} more, to {told[-1][0].name}")
    print(f"size        {camera.width} x {camera.height} px" if camera.width else "size        not in the file")
    if camera.width:
        h, v, d = _fields(camera)
        print(f"field       {h} across, {v} down, {d} corner to corner")
    profile = radial_profile(camera)
    centre = profile.centre
    print(f"focal       {profile.focal:.2f} px per radian on the axis")
    offset = np.array(centre) - (np.array(camera.size) - 1) / 2
    print(
        f"centre      ({centre[0]:.2f}, {centre[1]:.2f}),"
        f" {offset[0]:+.1f}, {offset[1]:+.1f} px from the picture's middle"
    )
    limit = np.degrees(model.theta_max)
    print(
        f"valid       to {limit:.1f} degrees from the axis"
        + ("" if limit >= 179.9 else ", where the model ends or folds over")
    )
    if camera.theta_max is not None:
        inner = f"from {np.degrees(camera.theta_min):.1f} " if camera.theta_min else ""
        print(f"calibrated  {inner}to {np.degrees(camera.theta_max):.1f} degrees from the axis; extrapolated past it")
    for key, value in camera.calibration.items():
        _tell(key, value)
    print("convention  x right, y down, z forward; integer pixel = pixel centre, top-left is (0, 0)")
    print(f"its file    {format_named(source).CONVENTION}")
    for key, value in camera.provenance.items():
        text = str(value)
        print(f"from        {key}: {text if len(text) < 90 else text[:87] + '...'}")
    for key, value in camera.extra.items():
        text = str(value)
        print(f"also        {key}: {text if len(text) < 90 else text[:87] + '...'}")
    print()
    print(to_text(profile))


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
    """Give the angles between opposite edges and corners of the picture, through its centre."""
    import numpy as np

    from omnisight.cli._profile import radial_profile

    u0, v0 = radial_profile(camera).centre
    w, h = camera.width - 0.5, camera.height - 0.5
    pairs = (((-0.5, v0), (w, v0)), ((u0, -0.5), (u0, h)), ((-0.5, -0.5), (w, h)))
    found: list[str] = []
    for pair in pairs:
        angles = np.degrees(camera.angle_of(np.array(pair)))
        found.append(f"{angles.sum():.1f} deg" if np.isfinite(angles).all() else "past the model's end")
    return found[0], found[1], found[2]

"""omnisight convert."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter


def convert(
    camera: Path,
    /,
    *,
    to: str,
    model: str | None = None,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    name: str | None = None,
    distance: str | None = None,
    max_theta: float | None = None,
    max_error: float = 1.0,
    force: bool = False,
) -> None:
    """Write a camera in another format, in another model if need be, and say how near it comes.

    Parameters
    ----------
    camera
        A calibration file of any format.
    to
        The format to write: native, ocamcalib, opencv, kalibr, colmap ...
    model
        The camera model to convert to; if the format cannot hold the camera's own, the one of its models that comes
        nearest.
    output
        The file to write; beside the camera's file unless told otherwise.
    name
        Which camera, where the file holds several.
    distance
        Of a camera whose rays do not meet in a point: how far what it looks at is, with its unit (2m, or inf). The
        central camera that fits there is written.
    max_theta
        Fit only up to this angle from the axis, degrees, instead of the calibrated cone.
    max_error
        Refuse to write what is farther off, px.
    force
        Write it all the same.
    """
    import numpy as np

    from omnisight.cli._central import central_camera
    from omnisight.conversion import conversions, convert_model
    from omnisight.formats import get_format, save
    from omnisight.models import model_names

    if to in model_names():
        raise ValueError(f"--to is for formats, and {to} is a camera model: --to native --model {to}")
    source = central_camera(camera, name=name, distance=distance)
    if distance is not None:
        fitted = source.provenance["central_of"]
        print(f"central     {source.model.name}, at most {fitted['differs_px']:.2g} px off for what is {distance} away")
        if fitted.get("mirrored"):
            print("frame       in the mirror's viewpoint; left and right are exchanged as in the image (view --flip)")
    chosen = get_format(to)
    limit = None if max_theta is None else float(np.radians(max_theta))
    if model is not None and model not in chosen.MODELS:
        raise ValueError(f"{chosen.TITLE} has no model {model}; it has {', '.join(chosen.MODELS)}")
    if model is None and source.model.name in chosen.MODELS:
        model = source.model.name
    if model == source.model.name:
        result = None
        converted = source
        print(f"model       {model}, as it is")
    else:
        result = (
            convert_model(source, model, theta_max=limit)
            if model
            else _nearest_held(conversions(source, chosen.MODELS, theta_max=limit), chosen)
        )
        converted = result.camera
        print(f"model       {source.model.name} -> {converted.model.name}")
        print(f"fitted      to {np.degrees(result.theta_max):.1f} degrees from the axis")
        print(f"error       at most {result.max_px:.3g} px, {result.max_deg:.3g} deg; ", end="")
        print(f"rms {result.rms_px:.3g} px, {result.rms_deg:.3g} deg")
        print(f"holds       within 0.5 px up to {np.degrees(result.holds_to):.1f} degrees")
        if not result.max_px <= max_error and not force:
            raise ValueError(_refusal(source, result, chosen, max_error, limit))
    path = output or camera.with_name(f"{camera.stem}-{to}{chosen.SUFFIX}")
    written = save(converted, path, format=to, max_error=float("inf") if force else max_error)
    print(f"written     {written.path}; read again it differs by {written.error_px:.2g} px at most")
    print(f"convention  {chosen.CONVENTION}")
    for note in written.notes:
        print(f"note        {note}")


def _refusal(source: Any, result: Any, chosen: Any, max_error: float, limit: float | None) -> str:
    """Say how far off the model is and where, and what would do: a narrower cone, another model."""
    import math

    from omnisight.conversion import conversions, reach

    name, own = result.camera.model.name, source.model.name
    worst = f"{math.degrees(result.worst):.0f} degrees"
    said = f"{result.max_px:.3g} px off at {worst}" if result.max_px < math.inf else f"no pixels past {worst}"
    widest = reach(source, name, max_error, theta_max=limit)
    ways: list[str] = []
    if widest is not None and math.floor(math.degrees(widest)) > 0:
        ways.append(f"--max-theta {math.floor(math.degrees(widest))}")
    others = [other for other in chosen.MODELS if other not in (name, own)]
    held = [own] if own in chosen.MODELS else []
    if others:
        near = (found for found in conversions(source, others, theta_max=limit) if found.max_px <= max_error)
        held += [found.camera.model.name for found in near]
    ways.append(f"--model {' or '.join(held[:3])}" if held else "--to native, which holds every model")
    return (
        f"{name} cannot represent this {own} camera to {math.degrees(result.theta_max):.0f} degrees: {said},"
        f" {max_error:g} allowed. Nothing is written; try {', '.join(ways)}, or --force"
    )


def _nearest_held(found: Any, chosen: Any) -> Any:
    """Give the nearest conversion that the format can hold: it may lack a parameter of a model that it has."""
    for conversion in found:
        try:
            chosen.render(conversion.camera)
        except ValueError:
            continue
        return conversion
    return found[0]

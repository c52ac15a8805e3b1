"""Report of `omnisight convert`."""

import math
from typing import Any

from omnisight.camera import Camera
from omnisight.cli._output import elapsed, write_json
from omnisight.conversion import Conversion
from omnisight.display import rounded
from omnisight.formats import SaveResult
from omnisight.pipeline.conversion.convert import ConversionError, ConvertResult
from omnisight.pipeline.conversion.convert_options import ConvertOptions
from omnisight.pipeline.conversion.convert_rig import ConvertRigResult
from omnisight.ray_camera import RayCamera


def print_report(result: ConvertResult, distance: str | None) -> None:
    """Print the fit of the model, and the file."""
    print_conversion(result.source, result.conversion, distance)
    _print_written(result.written, result.convention)


def print_rig_report(result: ConvertRigResult, options: ConvertOptions) -> None:
    """Print the fit of each camera of a rig, and the file."""
    rig = result.source
    width = max(6, *map(len, rig.names))
    print(f"{'camera':<{width}}  {'model':<42}  error px  error deg")
    for name, camera, conversion in zip(rig.names, rig.cameras, result.conversions, strict=True):
        if conversion is None:
            print(f"{name:<{width}}  {f'{camera.model.name}, unchanged':<42}  {0:8}  {0:9}")
            continue
        model = f"{camera.model.name} -> {conversion.camera.model.name}"
        print(f"{name:<{width}}  {model:<42}  {conversion.max_px:8.3g}  {conversion.max_deg:9.3g}")
    if options.invert_extrinsics:
        print("poses       inverted")
    _print_written(result.written, result.convention, rig.unit)


def print_conversion(source: Camera, conversion: Conversion | None, distance: str | None) -> None:
    """Print the fit of another model."""
    if distance is not None:
        fit = source.provenance["central_of"]
        print(f"central     {source.model.name}, at most {rounded(fit['differs_px'])} px off at {distance}")
        if fit.get("mirrored"):
            print(
                "frame       at the viewpoint of the mirror; left and right are exchanged as in the image (view --flip)"
            )
    if conversion is None:
        print(f"model       {source.model.name}, unchanged")
        return
    print(f"model       {source.model.name} -> {conversion.camera.model.name}")
    print(f"fitted      up to {math.degrees(conversion.theta_max):.1f} degrees from the axis")
    print(f"error       at most {rounded(conversion.max_px, 3)} px, {rounded(conversion.max_deg, 3)} deg; ", end="")
    print(f"rms {rounded(conversion.rms_px, 3)} px, {rounded(conversion.rms_deg, 3)} deg")
    print(f"agreement   within 0.5 px up to {math.degrees(conversion.agreement_theta):.1f} degrees from the axis")


def _print_written(written: SaveResult, convention: str, unit: str | None = None) -> None:
    poses = "" if unit is None else f", {rounded(written.rotation_deg)} deg, {rounded(written.translation)} {unit}"
    print(f"written     {written.path}; reads back within {rounded(written.error_px)} px{poses}")
    print(f"convention  {convention}")
    for note in written.notes:
        print(f"note        {note}")


def print_json(result: ConvertResult | ConvertRigResult, options: ConvertOptions) -> None:
    """Print the file, its accuracy, and the fit of each camera as one JSON object."""
    written = result.written
    data = {
        "format": options.format,
        "convention": result.convention,
        "files": [str(written.path)],
        "read_back_px": written.error_px,
        "notes": list(written.notes),
    }
    if isinstance(result, ConvertRigResult):
        fits = zip(result.source.names, result.rig.cameras, result.conversions, strict=True)
        data |= {
            "cameras": {name: _camera(camera, conversion) for name, camera, conversion in fits},
            "read_back_poses": {"deg": written.rotation_deg, result.source.unit: written.translation},
        }
    else:
        data |= {"camera": _camera(result.camera, result.conversion)}
    write_json(data | {"reason": "", "seconds": round(elapsed(), 3)})


def print_refusal_json(error: ConversionError, options: ConvertOptions) -> None:
    """Print the fit that was refused as one JSON object."""
    camera = _camera(error.conversion.camera, error.conversion)
    data = {"format": options.format, "files": [], "camera": camera, "reason": str(error)}
    write_json(data | {"seconds": round(elapsed(), 3)})


def _camera(camera: Camera | RayCamera, conversion: Conversion | None) -> dict[str, Any]:
    """Return the model of a camera, and its differences from the source; none if the model did not change."""
    data: dict[str, Any] = {"model": camera.model.name, "size": list(camera.size), "converted": conversion is not None}
    if conversion is None:
        return data
    figures = {
        "max_px": conversion.max_px,
        "max_deg": conversion.max_deg,
        "rms_px": conversion.rms_px,
        "rms_deg": conversion.rms_deg,
        "fitted_to_deg": math.degrees(conversion.theta_max),
        "agreement_deg": math.degrees(conversion.agreement_theta),
    }
    return data | {name: value if math.isfinite(value) else None for name, value in figures.items()}

"""Conversion of calibration files: the counterpart of `omnisight convert`."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from omnisight.camera import Camera
from omnisight.conversion import Conversion, convert_model, flip_frame, max_convertible_theta, rank_conversions
from omnisight.display import Displayed, rounded
from omnisight.extensions import unknown_name
from omnisight.formats import Format, SaveResult, get_format, save
from omnisight.images.output_paths import refuse_overwrite
from omnisight.models import model_names
from omnisight.pipeline.conversion.convert_options import ConvertOptions
from omnisight.pipeline.inputs.central_camera import central_camera

MAX_SUGGESTIONS = 3  # models in an error message


@dataclass(frozen=True)
class ConvertResult(Displayed):
    """The result of `convert`.

    Attributes
    ----------
    source
        The central camera that was converted.
    camera
        The camera that was written.
    conversion
        The fit of another model, or None if the model did not change.
    written
        The file and how accurately it reads back.
    convention
        The convention of the format, in one line.
    """

    source: Camera
    camera: Camera
    conversion: Conversion | None
    written: SaveResult
    convention: str


class ConversionError(ValueError):
    """No model of the format represents the camera accurately enough; nothing was written.

    Attributes
    ----------
    source
        The camera.
    conversion
        The fit that was refused.
    """

    def __init__(self, message: str, source: Camera, conversion: Conversion) -> None:
        super().__init__(message)
        self.source = source
        self.conversion = conversion


def convert(path: str | Path, options: ConvertOptions) -> ConvertResult:
    """Write a camera in another format, and in another camera model if the format or the options require it.

    `convert_rig` does so for all cameras of a rig.

    Parameters
    ----------
    path
        A calibration file of any format.
    options
        The format, the model and the accuracy.

    Returns
    -------
    result
        The camera, its difference from the source, and the file.

    Raises
    ------
    ConversionError
        If the model differs from the camera by more than `max_error_px`.
    ValueError
        If the format or the model is unknown, the file cannot be read or written or is its own output, or the model
        cannot be fitted.
    """
    path, target = Path(path), target_format(options)
    output = converted_file([path], target, options)
    if options.invert_extrinsics:
        raise ValueError(f"{path}: --invert-extrinsics is for rigs, and one camera is converted: leave it out")
    source = central_camera(path, name=options.name, distance=options.distance)
    conversion = fit_model(source, target, options)
    refuse_inaccurate({"": source}, [conversion], target, options)
    refuse_unused_angle([conversion], options)
    camera = source if conversion is None else conversion.camera
    camera, notes = _flipped(camera, path) if options.flip else (camera, ())
    max_error = math.inf if options.force else options.max_error_px
    written = save(camera, output, format=options.format, max_error=max_error)
    written = replace(written, notes=notes + written.notes)
    return ConvertResult(source, camera, conversion, written, target.CONVENTION)


def _flipped(camera: Camera, path: Path) -> tuple[Camera, tuple[str, ...]]:
    """Return the camera in the reflected frame, and a note on the fields of its file that are left out.

    Raises
    ------
    ValueError
        If the model cannot be reflected; the message names the file.
    """
    try:
        flipped = flip_frame(camera)
    except ValueError as error:
        raise ValueError(f"{path}: {error} (--model)") from error
    lost = [key for key in camera.extra if key not in flipped.extra]
    note = f"not written: {', '.join(lost)}: a reflected frame has no rotation from another frame"
    return flipped, (note,) if lost else ()


def target_format(options: ConvertOptions) -> Format:
    """Return the format to write; raise ValueError if there is none of this name."""
    if options.format in model_names():
        raise ValueError(f"{options.format} is a camera model, not a format: --to native --model {options.format}")
    return get_format(options.format)


def converted_file(paths: Sequence[Path], target: Format, options: ConvertOptions) -> Path:
    """Return the file to write; raise ValueError if it is one of the files that are read."""
    output = Path(options.output or paths[0].with_name(f"{paths[0].stem}-{options.format}{target.SUFFIX}"))
    refuse_overwrite([output], paths)
    return output


def refuse_unused_angle(conversions: Iterable[Conversion | None], options: ConvertOptions) -> None:
    """Raise ValueError if the options limit the angle of fits, and no model is fitted."""
    if options.max_theta_deg is not None and not any(conversion is not None for conversion in conversions):
        raise ValueError(
            f"--max-theta {options.max_theta_deg:g}: limits the fit of another model, and no model changes: leave it"
            " out, or specify --model"
        )


def refuse_inaccurate(
    sources: Mapping[str, Camera], conversions: Sequence[Conversion | None], target: Format, options: ConvertOptions
) -> None:
    """Raise an error if the model of a camera differs by more than `max_error_px`, unless `force`.

    Parameters
    ----------
    sources
        All cameras by name; one camera has no name, "".
    conversions
        Their fits; None if the model does not change.

    Raises
    ------
    ConversionError
        With the least accurate camera, and what would work for all of them.
    """
    fits = {name: fit for name, fit in zip(sources, conversions, strict=True) if fit is not None}
    refused = {name: fit for name, fit in fits.items() if not fit.max_px <= options.max_error_px}
    if refused and not options.force:
        worst = max(refused, key=lambda name: refused[name].max_px)
        raise ConversionError(_refusal(sources, refused, worst, target, options), sources[worst], refused[worst])


def fit_model(source: Camera, target: Format, options: ConvertOptions) -> Conversion | None:
    """Return the fit of the requested or the most accurate model of a format; None to keep the camera's model."""
    own = source.model.name
    if options.model is not None and options.model not in model_names():
        raise ValueError(unknown_name("camera model", options.model, target.MODELS))
    if options.model is not None and options.model not in target.MODELS:
        raise ValueError(f"{target.TITLE} has no model {options.model}; it has {', '.join(target.MODELS)}")
    model = options.model or (own if own in target.MODELS else None)
    if model == own:
        return None
    theta_max = _theta_max(options)
    if model is not None:
        return convert_model(source, model, theta_max=theta_max)
    ranked = rank_conversions(source, target.MODELS, theta_max=theta_max)
    # A format may lack a parameter of one of its models.
    return next((conversion for conversion in ranked if _can_hold(target, conversion.camera)), ranked[0])


def _theta_max(options: ConvertOptions) -> float | None:
    return None if options.max_theta_deg is None else math.radians(options.max_theta_deg)


def _can_hold(target: Format, camera: Camera) -> bool:
    """Return whether a format can write a camera."""
    try:
        target.serialize(camera)
    except ValueError:
        return False
    return True


def _refusal(
    sources: Mapping[str, Camera],
    refused: Mapping[str, Conversion],
    worst: str,
    target: Format,
    options: ConvertOptions,
) -> str:
    """Return a message with the error of a conversion and what would work for all cameras: an angle, another model."""
    conversion, max_px = refused[worst], options.max_error_px
    angle = f"{math.degrees(conversion.worst_theta):.0f} degrees"
    error = (
        f"{rounded(conversion.max_px, 3)} px off at {angle}"
        if conversion.max_px < math.inf
        else f"no pixels past {angle}"
    )
    others = ", ".join(name for name in refused if name != worst)
    suggestions: list[str] = []
    limits = [
        max_convertible_theta(sources[name], fit.camera.model.name, max_px, theta_max=_theta_max(options)) or 0.0
        for name, fit in refused.items()
    ]
    if math.degrees(min(limits)) >= 1:
        suggestions.append(f"--max-theta {math.floor(math.degrees(min(limits)))}")
    accurate = [_accurate_models(source, target, options) for source in sources.values()]
    models = [model for model in accurate[0] if all(model in of_camera for of_camera in accurate)]
    if models:
        suggestions.append(f"--model {' or '.join(models[:MAX_SUGGESTIONS])}")
    else:
        suggestions.append("--to native, which holds every model")
    return (
        f"{worst}{': ' * bool(worst)}{conversion.camera.model.name} cannot represent this"
        f" {sources[worst].model.name} camera to {math.degrees(conversion.theta_max):.0f} degrees: {error},"
        f" {max_px:g} allowed{f'; likewise {others}' * bool(others)}. Nothing was written; try"
        f" {', '.join(suggestions)}, or --force"
    )


def _accurate_models(source: Camera, target: Format, options: ConvertOptions) -> list[str]:
    """Return the models of a format that represent a camera accurately: its own, then the most accurate ones."""
    own = source.model.name
    others = [name for name in target.MODELS if name != own]
    try:
        ranked = rank_conversions(source, others, theta_max=_theta_max(options))
    except ValueError:  # none can be fitted
        ranked = []
    accurate = [fit.camera.model.name for fit in ranked if fit.max_px <= options.max_error_px]
    return ([own] if own in target.MODELS else []) + accurate

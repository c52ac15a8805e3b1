"""Conversion of the files of rigs: the counterpart of `omnisight convert` for several cameras."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from omnisight.camera import Camera
from omnisight.conversion import Conversion
from omnisight.display import Displayed
from omnisight.formats import FormatError, SaveResult, load_all, load_joined_rig, rig_format_names, save
from omnisight.models.ocam import Ocam
from omnisight.pipeline.conversion.convert import (
    converted_file,
    fit_model,
    refuse_inaccurate,
    refuse_unused_angle,
    target_format,
)
from omnisight.pipeline.conversion.convert_options import ConvertOptions
from omnisight.pipeline.conversion.ocam_roll import with_upright_ocam
from omnisight.pipeline.inputs.central_camera import central_approximation
from omnisight.rig import Rig


@dataclass(frozen=True)
class ConvertRigResult(Displayed):
    """The result of `convert_rig`.

    Attributes
    ----------
    source
        The rig that was converted; if its ocam cameras are fitted by other models, the rotation in their affine maps is
        part of the poses.
    rig
        The rig that was written.
    conversions
        For each camera the fit of another model, or None if the model did not change.
    written
        The file and how accurately it reads back.
    convention
        The convention of the format, in one line.
    """

    source: Rig
    rig: Rig
    conversions: tuple[Conversion | None, ...]
    written: SaveResult
    convention: str


def convert_rig(path: str | Path | Sequence[str | Path], options: ConvertOptions) -> ConvertRigResult:
    """Write a rig in another format, its cameras in other models if the format or the options require it.

    Parameters
    ----------
    path
        The file of a rig, of any format; or several files whose cameras have poses relative to the same IMU, which are
        joined to one rig.
    options
        The format, the model and the accuracy; `name` does not apply.

    Raises
    ------
    ConversionError
        If the model of a camera differs by more than `max_error_px`; the message names the cameras, and what would
        work for all of them.
    ValueError
        If the format holds no rigs, a file cannot be read or written or is the output, or a model cannot be fitted.
    """
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(item) for item in path]
    path, target = paths[0], target_format(options)
    output = converted_file(paths, target, options)
    if options.flip:
        raise ValueError(f"{path}: --flip is for one camera, and a rig is converted: specify --name")
    if options.format not in rig_format_names():
        raise ValueError(
            f"{target.TITLE} holds no rigs; {', '.join(rig_format_names())} do. To convert one of its cameras, specify"
            " --name"
        )
    try:
        rig = load_joined_rig(paths)
    except FormatError as error:
        for source_path in paths:
            load_all(source_path)  # raises the reason, without the advice, if a file holds no cameras
        raise FormatError(f"{error}. To convert one of its cameras, specify --name") from error
    source = rig.inverted() if options.invert_extrinsics else rig
    if Ocam.name not in target.MODELS or options.model not in (None, Ocam.name):
        source = with_upright_ocam(source)
    is_central = all(isinstance(sensor, Camera) for sensor in source.cameras)
    centrals: dict[str, Camera] = {}
    conversions: list[Conversion | None] = []
    for name, sensor in zip(source.names, source.cameras, strict=True):
        distance = options.distance if is_central or not isinstance(sensor, Camera) else None
        centrals[name] = central_approximation(sensor, distance, f"{path}, {name}")
        try:
            conversions.append(fit_model(centrals[name], target, options))
        except ValueError as error:
            raise ValueError(f"{path}: {name}: {error}") from error
    refuse_inaccurate(centrals, conversions, target, options)
    refuse_unused_angle(conversions, options)
    pairs = zip(centrals.values(), conversions, strict=True)
    converted = dataclasses.replace(source, cameras=tuple(c if fit is None else fit.camera for c, fit in pairs))
    max_error = math.inf if options.force else options.max_error_px
    written = save(converted, output, format=options.format, max_error=max_error)
    return ConvertRigResult(source, converted, tuple(conversions), written, target.CONVENTION)

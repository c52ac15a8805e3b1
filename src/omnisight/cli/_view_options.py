"""Options of views in several commands, and of several views in one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from omnisight.cli._text_options import parse_range, parse_size, text_parameter
from omnisight.pipeline.views.view_options import Range, ViewMotion, ViewOptions, ViewType, has_option

_HIDDEN = Parameter(parse=False)


@dataclass(frozen=True)
class _ViewOptions(ViewOptions):
    """Options of a view.

    Attributes
    ----------
    elevation
        Vertical field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    azimuth
        Horizontal field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    """

    elevation: Annotated[Range | None, text_parameter(parse_range)] = None
    azimuth: Annotated[Range | None, text_parameter(parse_range)] = None


@dataclass(frozen=True)
class CommonViewOptions(_ViewOptions):
    """Options of all views of a command; `RepeatedViewOptions` has the others."""

    to: Annotated[ViewType | None, _HIDDEN] = None
    fov: Annotated[float | None, _HIDDEN] = None
    yaw: Annotated[float, _HIDDEN] = 0.0
    pitch: Annotated[float | None, _HIDDEN] = None
    roll: Annotated[float, _HIDDEN] = 0.0
    size: Annotated[tuple[int, int] | None, _HIDDEN] = None


@dataclass(frozen=True, kw_only=True)
class RepeatedViewOptions:
    # Options that are specified once for all views of a command, or once for each, as `ViewOptions` describes them.
    __doc__ = ViewOptions.__doc__

    to: list[ViewType] | None = None
    fov: list[float] | None = None
    yaw: list[float] | None = None
    pitch: list[float] | None = None
    roll: list[float] | None = None
    size: Annotated[
        list[str] | None, Parameter(help="WIDTHxHEIGHT, px; cylinder, mercator and sphere use only the width.")
    ] = None

    def of_outputs(self, outputs: Sequence[str], common: CommonViewOptions) -> list[tuple[str, ViewOptions]]:
        """Return the file and the options of each view.

        Raises
        ------
        ValueError
            If an option was specified another number of times.
        """
        given: dict[str, Sequence[object]] = {name: values for name, values in vars(self).items() if values}
        if self.size:
            given["size"] = [parse_size(text) for text in self.size]
        views = [dict(vars(common)) for _ in outputs]
        for name, values in given.items():  # the type is the first
            for view, value in zip(*_viewed(name, values, views), strict=True):
                view[name] = value
        for name in ("elevation", "azimuth"):  # once for all views that have it
            if any(has_option(view["to"], name) for view in views):
                for view in views:
                    view[name] = view[name] if has_option(view["to"], name) else None
        return [(output, ViewOptions(**view)) for output, view in zip(outputs, views, strict=True)]


def _viewed(
    name: str, values: Sequence[object], views: Sequence[dict[str, Any]]
) -> tuple[Sequence[dict[str, Any]], Sequence[object]]:
    """Return the views that have an option, or all if none has it, and the value of each."""
    having = [view for view in views if has_option(view["to"], name)] or views
    if len(values) not in (1, len(having)):
        outputs = f"--output {len(views)} times"
        if len(having) < len(views):
            outputs += f", and {len(having)} of the outputs have it"
        raise ValueError(
            f"--{name} is given {len(values)} times and {outputs}: give it once for all views, or once for each, in the"
            " order of the outputs"
        )
    return having, values if len(values) > 1 else list(values) * len(having)


@dataclass(frozen=True)
class ExportedViewOptions(_ViewOptions):
    """Options of a view for another program.

    Attributes
    ----------
    to
        Type of the view: perspective by default, and a cylinder for a mirror camera.
    size
        WIDTHxHEIGHT of the view, px. For splat, the width of a view of 90 degrees; by default the resolution of the
        image is kept.
    interpolation
        Interpolation between image pixels, if the program offers it.
    apply_exif
        For splat and viewer, rotate images by their EXIF orientation, as for the reconstruction.
    """

    to: Annotated[ViewType | None, Parameter(name="--view")] = None
    size: Annotated[tuple[int, int] | None, text_parameter(parse_size)] = None
    interpolation: Literal["nearest", "bilinear", "bicubic", "lanczos"] | None = "bicubic"
    antialias: Annotated[bool, _HIDDEN] = True
    mark: Annotated[bool, _HIDDEN] = False
    scale_camera: Annotated[bool, _HIDDEN] = False


@dataclass(frozen=True, kw_only=True)
class ViewMotionOptions(ViewMotion):
    """Options of the motion of a view.

    Attributes
    ----------
    pan
        FIRST:LAST yaw of a view that turns at constant speed during the clip, in place of --yaw.
    """

    pan: Annotated[Range | None, text_parameter(parse_range)] = None

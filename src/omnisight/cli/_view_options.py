"""Options of views in several commands, and of several views in one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from omnisight.cli._text_options import parse_range, parse_size

if TYPE_CHECKING:
    from omnisight.pipeline.view_options import ViewOptions


ViewType = Literal["perspective", "cylinder", "mercator", "sphere", "cube", "planet", "fisheye", "panini"]

# A range usually starts with a minus sign.
Angles = Annotated[str | None, Parameter(allow_leading_hyphen=True)]


@dataclass(frozen=True, kw_only=True)
class SharedViewOptions:
    """Options that `view` and `export` share.

    Attributes
    ----------
    up
        Where the world's up is: top of the image; back, for a camera that looks down or into a mirror above it; or
        front, for one that looks up. By default back for a mirror camera, top for others.
    flip
        Exchange left and right, for a camera that looks into one mirror.
    elevation
        Vertical field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    azimuth
        Horizontal field of view of a cylinder, mercator or sphere: LOW:HIGH in degrees.
    projection
        Projection of a fisheye.
    name
        Name of the camera in a file of several, such as a rig.
    distance
        Scene distance with its unit (2m, or inf), for a non-central camera.
    """

    up: Literal["top", "back", "front"] | None = None
    flip: bool = False
    elevation: Angles = None
    azimuth: Angles = None
    projection: Literal["equidistant", "equisolid", "stereographic", "orthographic"] = "equidistant"
    name: str | None = None
    distance: str | None = None

    @property
    def values(self) -> dict[str, Any]:
        """The values of `ViewOptions`.

        Raises
        ------
        ValueError
            If a range cannot be read.
        """
        return vars(self) | {
            "elevation": parse_range(self.elevation, "--elevation") if self.elevation else None,
            "azimuth": parse_range(self.azimuth, "--azimuth") if self.azimuth else None,
        }


def view_options(
    outputs: Sequence[str], each: Mapping[str, Sequence[Any] | None], common: Mapping[str, Any]
) -> list[tuple[str, "ViewOptions"]]:
    """Return the file and the options of each view.

    Parameters
    ----------
    outputs
        The files.
    each
        Values of options that were given once, for all views, or once for each.
    common
        Options of all views.

    Raises
    ------
    ValueError
        If an option was given another number of times.
    """
    from omnisight.pipeline.view_options import ViewOptions

    for name, values in each.items():
        if values and len(values) not in (1, len(outputs)):
            raise ValueError(
                f"--{name} is given {len(values)} times and --output {len(outputs)} times: give it once for all views,"
                " or once for each, in the order of the outputs"
            )
    views: list[tuple[str, ViewOptions]] = []
    for k, output in enumerate(outputs):
        own = {name: values[k if len(values) > 1 else 0] for name, values in each.items() if values}
        if "size" in own:
            own["size"] = parse_size(own["size"])
        views.append((output, ViewOptions(**common, **own)))
    return views

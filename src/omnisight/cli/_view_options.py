"""Options of several views in one command."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnisight.cli._size import parse_size

if TYPE_CHECKING:
    from omnisight.pipeline.view_options import ViewOptions


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

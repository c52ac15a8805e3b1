"""Non-central cameras to calibrate: each file of this folder that does not begin with an underscore holds one."""

from omnisight.extensions import class_in, names_in
from omnisight.optics.ray_model import RayModel

__all__ = ["ray_model_class", "ray_model_names"]


def ray_model_names() -> tuple[str, ...]:
    """Give the names of all non-central cameras, sorted: the names of the files here."""
    return names_in(__name__)


def ray_model_class(name: str) -> type[RayModel]:
    """Give the non-central camera of that name.

    Raises
    ------
    ValueError
        If there is no such camera; the message lists the names.
    """
    return class_in(__name__, name, RayModel, "non-central camera")

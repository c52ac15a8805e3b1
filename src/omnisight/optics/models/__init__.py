"""Non-central camera models for calibration. Each file of this folder without a leading underscore defines one."""

from omnisight.extensions import class_in, names_in
from omnisight.optics.ray_model import RayModel

__all__ = ["ray_model_class", "ray_model_names"]


def ray_model_names() -> tuple[str, ...]:
    """Return the names of all non-central camera models, sorted."""
    return names_in(__name__)


def ray_model_class(name: str) -> type[RayModel]:
    """Return the non-central camera model of a name.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known names.
    """
    return class_in(__name__, name, RayModel, "non-central camera")

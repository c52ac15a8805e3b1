"""Central camera models: one per file whose name does not begin with an underscore.

A new file adds its model to the tests, the command line, the formats and the docs.
"""

from omnisight.extensions import class_in, names_in
from omnisight.models._camera_model import CameraModel
from omnisight.models._parameter import Parameter, parameter
from omnisight.models._profile_camera import ProfileCamera
from omnisight.models._projector import Projector

__all__ = [
    "CameraModel",
    "Parameter",
    "Projector",
    "auto_models",
    "initial_models",
    "model_class",
    "model_names",
    "parameter",
]


def model_names() -> tuple[str, ...]:
    """Return the sorted names of all camera models, which are the names of the files."""
    return names_in(__name__)


def model_class(name: str) -> type[CameraModel]:
    """Return the camera model with a name.

    Raises
    ------
    ValueError
        If there is no such model; the message lists the available names.
    """
    return class_in(__name__, name, CameraModel, "camera model")


def auto_models(theta: float) -> tuple[str, ...]:
    """Return the names of the models that `--model auto` tries for corners up to an off-axis angle (radians)."""
    return tuple(name for name in model_names() if theta < model_class(name).auto_max_theta)


def initial_models() -> tuple[type[ProfileCamera], ...]:
    """Return the models that the search for the initial camera samples: together they follow lenses and mirrors."""
    models = (model_class(name) for name in model_names())
    return tuple(cls for cls in models if issubclass(cls, ProfileCamera) and cls.in_initial_search)

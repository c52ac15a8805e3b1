"""Camera models: each file of this folder that does not begin with an underscore holds one.

A model is found by its file. Adding a file adds it to the tests, the command line, the formats and the docs.
"""

from omnisight.extensions import class_in, names_in
from omnisight.models._camera_model import CameraModel
from omnisight.models._parameter import Parameter, parameter
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
    """Give the names of all camera models, sorted: the names of the files here."""
    return names_in(__name__)


def model_class(name: str) -> type[CameraModel]:
    """Give the model of that name.

    Raises
    ------
    ValueError
        If there is no such model; the message lists the names.
    """
    return class_in(__name__, name, CameraModel, "camera model")


def auto_models(theta: float) -> tuple[str, ...]:
    """Return the names of the models that `--model auto` tries for corners up to an off-axis angle (radians)."""
    return tuple(name for name in model_names() if theta < model_class(name).auto_max_theta)


def initial_models() -> tuple[type[CameraModel], ...]:
    """Return the models that the search for the initial camera samples: together they follow lenses and mirrors."""
    return tuple(cls for name in model_names() if (cls := model_class(name)).in_initial_search)

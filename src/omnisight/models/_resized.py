"""What a camera becomes when its picture is resized."""

from typing import TypeVar

from omnisight.models._parametric import Parametric

Model = TypeVar("Model", bound=Parametric)


def resized(model: Model, factor: float) -> Model:
    """Give the model of the picture resized by a factor; a pixel centre c goes to (c + 1/2) factor - 1/2."""
    params = model.params.copy()
    for i, parameter in enumerate(model.parameters):
        name = parameter.name
        if name in ("cx", "cy"):
            params[i] = (params[i] + 0.5) * factor - 0.5
        elif parameter.unit == "px":
            params[i] *= factor
        elif name[0] == "a" and name[1:].isdigit():  # f(r) = a0 + a2 r^2 ... with r in pixels
            params[i] *= factor ** (1 - int(name[1:]))
    return model.with_params(params)

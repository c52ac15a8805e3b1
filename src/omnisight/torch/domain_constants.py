"""The numbers that formulas need besides the parameters: limits of the domain and starts of iterations.

They come from the NumPy model with the current values of the parameters, by an operator that compiled functions call
without looking inside.
"""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from omnisight.models import CameraModel, model_class

# Parameters of that many cameras keep their constants.
CACHED_CAMERAS = 64


def domain_constants(model: CameraModel) -> dict[str, Any]:
    """Return the constants of a model by name, with the pixel of the axis, where every model has finite derivatives."""
    with np.errstate(all="ignore"):
        constants = {**model.projection_constants(), **model.unprojection_constants()}
        axis_u, axis_v = model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
    return constants | {"axis_u": axis_u, "axis_v": axis_v}


def flattened(model: CameraModel) -> np.ndarray[Any, Any]:
    """Return all constants of a model in one vector (K,)."""
    return np.concatenate([np.ravel(value) for value in domain_constants(model).values()])


def numpy_model(parameters: Sequence[torch.Tensor], model: str) -> CameraModel:
    """Return the NumPy model with the values of the parameters.

    Parameters on another device are read only if they changed: reading waits for the device.

    Raises
    ------
    ValueError
        If a value is not finite.
    """
    if parameters[0].device.type == "cpu":
        return _model_of_values(parameters, model)
    return kept_by_version(parameters, (model,), lambda: _model_of_values(parameters, model))


# What was computed of the last parameters, by their memory and version. The parameters are kept: the memory of a freed
# tensor may be used again.
_latest: OrderedDict[tuple[Any, ...], tuple[list[torch.Tensor], Any]] = OrderedDict()


def kept_by_version(parameters: Sequence[torch.Tensor], key: tuple[Any, ...], compute: Callable[[], Any]) -> Any:
    """Return a result that depends on a key and on parameters, without reading the parameters unless they changed.

    Changes are noticed by the version of a tensor, which in-place changes of `parameter.data` do not count: change the
    parameters themselves, in `torch.no_grad()`.
    """
    if any(parameter.is_inference() for parameter in parameters):  # have no version
        return compute()
    key = *key, *[parameter.data_ptr() for parameter in parameters], *[parameter._version for parameter in parameters]
    found = _latest.get(key)
    if found is None:
        found = _latest[key] = [parameter.detach() for parameter in parameters], compute()
        if len(_latest) > CACHED_CAMERAS:
            _latest.popitem(last=False)
    return found[1]


def _model_of_values(parameters: Sequence[torch.Tensor], model: str) -> CameraModel:
    lengths = tuple(parameter.numel() for parameter in parameters)
    values = torch.cat([parameter.detach().double().reshape(-1) for parameter in parameters]).cpu().numpy()
    return _model_from_bytes(model, lengths, values.tobytes())


@lru_cache(maxsize=CACHED_CAMERAS)
def _model_from_bytes(name: str, lengths: tuple[int, ...], values: bytes) -> CameraModel:
    parts = np.split(np.frombuffer(values), np.cumsum(lengths)[:-1])
    if not all(np.isfinite(part).all() for part in parts):
        raise ValueError(f"the parameters of the {name} camera are not finite: lower the learning rate")
    fields = dataclasses.fields(model_class(name))  # pyright: ignore[reportArgumentType]
    # A tuple of one number is a tuple: the type of the field decides.
    arguments = [
        tuple(map(float, part)) if field.type == tuple[float, ...] else float(part[0])
        for field, part in zip(fields, parts, strict=True)
    ]
    return model_class(name)(*arguments)


@lru_cache(maxsize=CACHED_CAMERAS)
def _flattened_on(device: torch.device, model: CameraModel) -> torch.Tensor:
    return torch.from_numpy(flattened(model)).to(device)


@torch.library.custom_op("omnisight::domain_constants", mutates_args=())
def constants_vector(parameters: list[torch.Tensor], model: str, count: int) -> torch.Tensor:
    """Return the `count` constants of a model with the values of its parameters, in one float64 vector (count,)."""
    return _flattened_on(parameters[0].device, numpy_model(parameters, model)).clone()


@constants_vector.register_fake
def _(parameters: list[torch.Tensor], model: str, count: int) -> torch.Tensor:  # pyright: ignore[reportUnusedFunction]
    return torch.empty(count, dtype=torch.float64, device=parameters[0].device)

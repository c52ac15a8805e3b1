"""The elementwise formulas of camera models on tensors: on every device, compiled, and differentiable repeatedly."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from omnisight.models import CameraModel
from omnisight.models._elementwise import MAX_ITERATIONS, project_point, unproject_pixel
from omnisight.torch.domain_constants import constants_vector, domain_constants
from omnisight.torch.tensor_functions import is_traced


class FormulaValues:
    """The parameters and constants that formulas take, by name, and the class of the model."""

    axis_u: Tensor
    axis_v: Tensor

    def __init__(self, model: type[CameraModel]) -> None:
        self.model = model


class Formulas:
    """The formulas of a model for tensors of its parameters.

    Parameters
    ----------
    model
        A model with the lengths of the coefficients; their values do not matter.

    Attributes
    ----------
    model
        The class of the model.
    fields
        Names of its parameters.
    """

    def __init__(self, model: CameraModel) -> None:
        self.model = type(model)
        self.fields = tuple(field.name for field in dataclasses.fields(model))  # pyright: ignore[reportArgumentType]
        # Compiled loops take tuples as they are, unless their kernel has arrays in their place.
        taken = self.model.kernel_type._fields
        self._unbound = [name for name in self.fields if name in taken and isinstance(getattr(model, name), tuple)]
        self._shapes = {name: np.shape(value) for name, value in domain_constants(model).items()}
        self._counts = [int(np.prod(shape)) for shape in self._shapes.values()]

    def project(self, points: Tensor, parameters: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Return pixels (..., 2), NaN where not valid, and their validity (...) of points (..., 3)."""
        return self._apply(project_point, points, points.new_tensor((0.0, 0.0, 1.0)), self._values(points, parameters))

    def unproject(self, pixels: Tensor, parameters: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Return bearings (..., 3), NaN where not valid, and their validity (...) of pixels (..., 2)."""
        m = self._values(pixels, parameters)
        return self._apply(unproject_pixel, pixels, torch.stack([m.axis_u, m.axis_v]), m)

    def _values(self, array: Tensor, parameters: Sequence[Tensor]) -> FormulaValues:
        """Return the values of the formulas in the type of an array."""
        m = FormulaValues(self.model)
        for field, parameter in zip(self.fields, parameters, strict=True):
            setattr(m, field, parameter.to(array.dtype))
        for field, value in self.model.derived(m).items():
            setattr(m, field, value)
        for field in self._unbound:
            setattr(m, field, getattr(m, field).unbind())
        vector = constants_vector([p.detach() for p in parameters], self.model.name, sum(self._counts))
        parts = vector.to(array.dtype).split(self._counts)
        for (field, shape), part in zip(self._shapes.items(), parts, strict=True):
            setattr(m, field, part.reshape(shape))
        return m

    @staticmethod
    def _apply(formula: Any, array: Tensor, safe: Tensor, m: FormulaValues) -> tuple[Tensor, Tensor]:
        """Return the values of a formula at points (..., K), NaN where not valid, and their validity.

        Derivatives at points outside the domain may be NaN, which would spread to the parameters: a first pass finds
        the valid points, and a second one with derivatives replaces the others by the point `safe`.
        """
        iterations = m.model.unrolled_steps if is_traced(array) else MAX_ITERATIONS
        with torch.no_grad():
            *values, valid = formula(m, *array.unbind(-1), iterations)
            valid = valid & (torch.abs(values[0]) != torch.inf)
        if torch.is_grad_enabled():
            *values, _ = formula(m, *torch.where(valid[..., None], array, safe).unbind(-1), iterations)
        return torch.where(valid[..., None], torch.stack(values, -1), torch.nan), valid

"""The elementwise formulas of camera models on tensors: on every device, compiled, and differentiable repeatedly."""

import dataclasses
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from omnisight.models import CameraModel
from omnisight.models._elementwise import MAX_ITERATIONS, project_point, unproject_pixel
from omnisight.torch.domain_constants import CACHED_CAMERAS, constants_vector, domain_constants, numpy_model
from omnisight.torch.tensor_functions import has_derivative, is_traced

Method = Literal["project", "unproject"]
FORMULAS = {"project": project_point, "unproject": unproject_pixel}


class FormulaValues:
    """The parameters and constants that formulas take, by name, and the class of the model."""

    axis_u: Any
    axis_v: Any

    def __init__(self, model: type[CameraModel]) -> None:
        self.model = model


class Formula:
    """The projection or the unprojection of a model for tensors of its parameters.

    Formulas of the same class of model with the same lengths of coefficients are equal.

    Parameters
    ----------
    method
        The method of the model.
    model
        A model with the lengths of the coefficients; their values do not matter.

    Attributes
    ----------
    method
        The method of the model.
    model
        The class of the model.
    fields
        Names of its parameters.
    parameter_count, vector_length
        Number of values of the parameters, and of these and the constants.
    has_tables
        Whether the formulas index a parameter.
    """

    def __init__(self, method: Method, model: CameraModel) -> None:
        self.method: Method = method
        self.model = type(model)
        self.fields = tuple(field.name for field in dataclasses.fields(model))  # pyright: ignore[reportArgumentType]
        parameters, constants = {name: getattr(model, name) for name in self.fields}, domain_constants(model)
        self._shapes = {name: np.shape(value) for name, value in (parameters | constants).items()}
        self._counts = [int(np.prod(shape)) for shape in self._shapes.values()]
        self.parameter_count, self.vector_length = sum(self._counts[: len(self.fields)]), sum(self._counts)
        # Compiled loops take tuples as they are, unless their kernel has arrays in their place.
        taken, tuples = self.model.kernel_type._fields, [n for n in self.fields if isinstance(parameters[n], tuple)]
        self._unbound = [name for name in tuples if name in taken]
        self.has_tables = len(self._unbound) < len(tuples)
        self._key = method, self.model, tuple(self._shapes.values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Formula) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def evaluate(self, array: Tensor, parameters: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Return pixels or bearings, NaN where not valid, and their validity (...), with derivatives.

        Derivatives at points outside the domain may be NaN, which would propagate to the parameters: a first pass finds
        the valid points, and a second one with derivatives replaces the others.
        """
        traced = any(map(is_traced, (array, *parameters)))
        iterations = self.model.unrolled_steps if traced else MAX_ITERATIONS
        by_parameters = traced or any(map(has_derivative, parameters))
        # Numbers are cheaper: each operation on a tensor of one parameter runs on the device.
        numbers = None if traced else self._numbers(array, parameters)
        m = self.values_of(self.vector(array, parameters)) if by_parameters or numbers is None else numbers
        with torch.no_grad():
            values, valid = self.values(array, m if numbers is None else numbers, iterations)
        if by_parameters or has_derivative(array):
            values = torch.stack(self.components(self.inside(array.unbind(-1), valid, m), m, iterations)[0], -1)
        return torch.where(valid[..., None], values, torch.nan), valid

    def values(self, array: Tensor, m: FormulaValues, iterations: int) -> tuple[Tensor, Tensor]:
        """Return pixels (..., 2) of points (..., 3), or bearings of pixels, and which are valid; the others are any."""
        values, valid = self.components(array.unbind(-1), m, iterations)
        return torch.stack(values, -1), valid

    def components(self, array: Sequence[Tensor], m: FormulaValues, iterations: int) -> tuple[list[Tensor], Tensor]:
        """Return the components of `values` of the components of points or pixels, which a compiler fuses."""
        *values, valid = FORMULAS[self.method](m, *array, iterations)
        return values, valid & (torch.abs(values[0]) != torch.inf)

    def inside(self, array: Sequence[Tensor], valid: Tensor, m: FormulaValues) -> list[Tensor]:
        """Return the components of points or pixels, of those of the axis in place of the ones that are not valid."""
        axis = (0.0, 0.0, 1.0) if self.method == "project" else (m.axis_u, m.axis_v)
        return [torch.where(valid, x, at) for x, at in zip(array, axis, strict=True)]

    def vector(self, array: Tensor, parameters: Sequence[Tensor]) -> Tensor:
        """Return the parameters and the constants in one vector of the type of an array."""
        constants = constants_vector(
            [p.detach() for p in parameters], self.model.name, self.vector_length - self.parameter_count
        )
        parts = *(parameter.reshape(-1) for parameter in parameters), constants
        return torch.cat([part.to(array.dtype) for part in parts])

    def values_of(self, vector: Tensor) -> FormulaValues:
        """Return the values that formulas take, of the vector of parameters and constants."""
        return self.values_from(self.parts(vector))

    def parts(self, vector: Tensor) -> list[Tensor]:
        """Return the parameters and constants that a vector contains."""
        shapes = self._shapes.values()
        return [part.reshape(shape) for part, shape in zip(vector.split(self._counts), shapes, strict=True)]

    def values_from(self, parts: Sequence[Tensor]) -> FormulaValues:
        """Return the values that formulas take, of the parameters and constants.

        Parameters may have one more axis, that of points.
        """
        m = FormulaValues(self.model)
        for name, part in zip(self._shapes, parts, strict=True):
            setattr(m, name, part)
        for name, value in self.model.derived(m).items():
            setattr(m, name, value)
        for name in self._unbound:
            setattr(m, name, getattr(m, name).unbind())
        return m

    def _numbers(self, array: Tensor, parameters: Sequence[Tensor]) -> FormulaValues:
        return _numbers_on(array.device, array.dtype, numpy_model(parameters, self.model.name))


class BoundFormula(NamedTuple):
    """A formula and its parameters."""

    formula: Formula
    parameters: Sequence[Tensor]

    @property
    def numpy_model(self) -> CameraModel:
        """The NumPy model with the values of the parameters."""
        return numpy_model(self.parameters, self.formula.model.name)

    def evaluate(self, array: Tensor) -> tuple[Tensor, Tensor]:
        """Return the values of the formula with derivatives; see `Formula.evaluate`."""
        return self.formula.evaluate(array, self.parameters)


class Bounds(NamedTuple):
    """Bounds of the pixels that an image covers: from the first to below the second."""

    left: Any
    right: Any
    top: Any
    bottom: Any

    def contain(self, u: Any, v: Any) -> Any:
        """Return which pixels are covered."""
        return (u >= self.left) & (u < self.right) & (v >= self.top) & (v < self.bottom)


class BoundMap(NamedTuple):
    """The pixels of a source that the pixels of a view show.

    Attributes
    ----------
    project, unproject
        The functions of the source and of the view.
    rotation
        (..., 3, 3) rotations of bearings from the view to the source.
    size
        (width, height) of the view.
    bounds
        Bounds of the pixels that the image of the source covers.
    """

    project: BoundFormula
    unproject: BoundFormula
    rotation: Tensor
    size: tuple[int, int]
    bounds: Bounds

    @property
    def formulas(self) -> tuple[Formula, Formula]:
        """The formulas of the source and of the view."""
        return self.project.formula, self.unproject.formula

    @property
    def variables(self) -> tuple[Tensor, ...]:
        """The rotation and the parameters of both cameras."""
        return self.rotation, *self.project.parameters, *self.unproject.parameters


@lru_cache(maxsize=CACHED_CAMERAS)
def _numbers_on(device: torch.device, dtype: torch.dtype, model: CameraModel) -> FormulaValues:
    """Return the values that formulas take as numbers, with tables as tensors."""
    m = FormulaValues(type(model))
    for name, value in (model.kernel_values() | domain_constants(model)).items():
        if isinstance(value, np.ndarray) and value.ndim:
            value = torch.tensor(value, dtype=dtype, device=device)
        setattr(m, name, value if isinstance(value, tuple | torch.Tensor) else float(value))
    return m

"""Dataclasses with a flat parameter vector: camera models, mirrors, and systems composed of them."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.models._parameter import Parameter, finite

Array = NDArray[np.float64]


class Parameterized(Displayed):
    """Base of frozen dataclasses whose fields, in order, are parameters of one flat vector.

    A field is a number, a tuple of numbers, a `Parameterized` part, or a tuple of such parts. Parameters of a part keep
    their names; those of a tuple of parts are prefixed by `coefficient_names` (mirror0_radius). Solvers use only the
    vector, the names and the bounds.
    """

    name: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Name the class after its file."""
        super().__init_subclass__()
        cls.name = cls.__module__.rpartition(".")[2]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Metadata of each parameter, in the order of `params`."""
        parameters: list[Parameter] = []
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            value: Any = getattr(self, field.name)
            is_tuple = isinstance(value, tuple)
            names = self.coefficient_names(len(value), field.name) if is_tuple else (field.name,)
            for name, part in zip(names, value if is_tuple else (value,), strict=True):
                if isinstance(part, Parameterized):
                    prefix = f"{name}_" if is_tuple else ""
                    parameters += [dataclasses.replace(p, name=prefix + p.name) for p in part.parameters]
                else:
                    parameters.append(Parameter(name, **field.metadata))
        return tuple(parameters)

    @staticmethod
    def coefficient_names(count: int, field: str) -> tuple[str, ...]:
        """Return the names of the coefficients or parts of a tuple field: the name of the field and a number."""
        return tuple(f"{field}{i}" for i in range(count))

    @cached_property
    def param_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `params`."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the parameters, (P,) and (P,)."""
        return np.array([p.low for p in self.parameters]), np.array([p.high for p in self.parameters])

    @cached_property
    def prior_sigmas(self) -> Array:
        """Prior standard deviations of the parameters (P,): `Parameter.prior_sigma`."""
        return np.array([p.prior_sigma for p in self.parameters])

    @cached_property
    def params(self) -> Array:
        """Parameters (P,) as one flat, read-only vector."""
        flat = np.hstack([_numbers(getattr(self, f.name)) for f in dataclasses.fields(self)])  # pyright: ignore[reportArgumentType]
        flat.flags.writeable = False
        return flat

    def with_params(self, params: ArrayLike) -> Self:
        """Return a copy with other parameters (P,)."""
        vector = np.asarray(params, float)
        if vector.shape != self.params.shape:
            raise ValueError(f"{self.name} has {self.params.size} parameters, got an array of shape {vector.shape}")
        values, start = {}, 0
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            old = getattr(self, field.name)
            stop = start + (1 if isinstance(old, float) else _numbers(old).size)
            values[field.name] = _with_numbers(old, vector[start:stop])
            start = stop
        copy = dataclasses.replace(self, **values)  # pyright: ignore[reportArgumentType]
        # The metadata does not change; solvers call this at every step.
        copy.__dict__.update(
            {name: getattr(self, name) for name in ("parameters", "param_names", "bounds", "prior_sigmas")}
        )
        return copy

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Return a copy with other values of some parameters by name; unknown names are ignored."""
        return self.with_params([values.get(name, value) for name, value in self.to_dict().items()])

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters by name."""
        return dict(zip(self.param_names, map(float, self.params), strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Create the model from its parameters by name.

        Raises
        ------
        ValueError
            If a name is missing or unknown, or a value is not a finite number.
        """
        names: dict[str, tuple[str, ...]] = {}
        required: set[str] = set()
        for field in dataclasses.fields(cls):  # pyright: ignore[reportArgumentType]
            names[field.name] = (field.name,)
            if field.type == tuple[float, ...]:
                # The length follows from the names that are present.
                count = sum(name.startswith(field.name) and name[len(field.name) :].isdecimal() for name in values)
                names[field.name] = cls.coefficient_names(max(count, 1), field.name)
            if field.default is dataclasses.MISSING:
                required.update(names[field.name])
        known = [name for part in names.values() for name in part]
        if missing := sorted(required - set(values)):
            raise ValueError(f"model {cls.name}: missing {', '.join(missing)}")
        if unknown := sorted(set(values) - set(known)):
            raise ValueError(f"model {cls.name} has no {', '.join(unknown)}; it has {', '.join(known)}")
        numbers = {n: finite(values[n], f"{cls.name}.{n}") for n in known if n in values}
        return cls(
            **{
                field: numbers[field] if part == (field,) else tuple(numbers[n] for n in part)
                for field, part in names.items()
                if part[0] in numbers
            }
        )


def _numbers(value: Any) -> Array:
    """Return the numbers in the value of a field."""
    if isinstance(value, Parameterized):
        return value.params
    if isinstance(value, tuple) and value and isinstance(value[0], Parameterized):
        return np.hstack([part.params for part in value])
    return np.asarray(value, float).ravel()


def _with_numbers(value: Any, numbers: Array) -> Any:
    """Return the value of a field with other numbers."""
    if isinstance(value, float):
        return float(numbers[0])
    if isinstance(value, Parameterized):
        return value.with_params(numbers)
    if isinstance(value, tuple) and value and isinstance(value[0], Parameterized):
        ends = np.cumsum([part.params.size for part in value])
        return tuple(part.with_params(n) for part, n in zip(value, np.split(numbers, ends[:-1]), strict=True))
    return tuple(map(float, numbers)) if isinstance(value, tuple) else float(numbers[0])

"""What has parameters: cameras, and the mirrors they look into."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._parameter import Parameter, finite

Array = NDArray[np.float64]


class Parametric:
    """What is known by its parameters: a frozen dataclass whose fields, in order, are numbers or tuples of numbers.

    Solvers see one flat vector, names and bounds, and never the class.
    """

    name: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Name it after its file."""
        cls.name = cls.__module__.rpartition(".")[2]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is known of each parameter, in the order of `params`."""
        found: list[Parameter] = []
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            value = getattr(self, field.name)
            names = self.coefficient_names(len(value), field.name) if isinstance(value, tuple) else (field.name,)
            found += [Parameter(name, **field.metadata) for name in names]
        return tuple(found)

    @staticmethod
    def coefficient_names(count: int, field: str) -> tuple[str, ...]:
        """Name the coefficients of a parameter that is a tuple: the field's name and a number."""
        return tuple(f"{field}{i}" for i in range(count))

    @cached_property
    def param_names(self) -> tuple[str, ...]:
        """The names of the parameters, in the order of `params`."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def params(self) -> Array:
        """The parameters (P,) as one flat, read-only vector."""
        values = [getattr(self, f.name) for f in dataclasses.fields(self)]  # pyright: ignore[reportArgumentType]
        flat = np.hstack([np.asarray(v, float).ravel() for v in values])
        flat.flags.writeable = False
        return flat

    def with_params(self, params: ArrayLike) -> Self:
        """Give the camera of this model with other parameters (P,)."""
        vector = np.asarray(params, float)
        if vector.shape != self.params.shape:
            raise ValueError(f"{self.name} has {self.params.size} parameters, got an array of shape {vector.shape}")
        values, start = {}, 0
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            old = getattr(self, field.name)
            count = len(old) if isinstance(old, tuple) else 1
            part = tuple(float(p) for p in vector[start : start + count])
            values[field.name] = part if isinstance(old, tuple) else part[0]
            start += count
        return dataclasses.replace(self, **values)  # pyright: ignore[reportArgumentType]

    def to_dict(self) -> dict[str, float]:
        """Give the parameters by name."""
        return dict(zip(self.param_names, map(float, self.params), strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> Self:
        """Make the model from its parameters by name.

        Raises
        ------
        ValueError
            If a name is missing or unknown, or a value is no finite number.
        """
        names: dict[str, tuple[str, ...]] = {}
        needed: set[str] = set()
        for field in dataclasses.fields(cls):  # pyright: ignore[reportArgumentType]
            names[field.name] = (field.name,)
            if field.type == tuple[float, ...]:
                # As long as the values have names of it.
                count = sum(name.startswith(field.name) and name[len(field.name) :].isdecimal() for name in values)
                names[field.name] = cls.coefficient_names(max(count, 1), field.name)
            if field.default is dataclasses.MISSING:
                needed.update(names[field.name])
        known = [name for part in names.values() for name in part]
        if missing := sorted(needed - set(values)):
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

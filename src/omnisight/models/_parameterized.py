"""What has parameters: cameras, the mirrors they look into, and what is made of parts that have some."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._parameter import Parameter, finite

Array = NDArray[np.float64]


class Parameterized:
    """What is known by its parameters: a frozen dataclass whose fields, in order, hold them.

    A field is a number, a tuple of numbers, a part that is Parameterized itself, or a tuple of such parts. Parameters of a
    part keep their names; those of a tuple of parts begin with `coefficient_names` of it (mirror_radius).
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
            value: Any = getattr(self, field.name)
            several = isinstance(value, tuple)
            names = self.coefficient_names(len(value), field.name) if several else (field.name,)
            for name, part in zip(names, value if several else (value,), strict=True):
                if isinstance(part, Parameterized):
                    before = f"{name}_" if several else ""
                    found += [dataclasses.replace(p, name=before + p.name) for p in part.parameters]
                else:
                    found.append(Parameter(name, **field.metadata))
        return tuple(found)

    @staticmethod
    def coefficient_names(count: int, field: str) -> tuple[str, ...]:
        """Name the coefficients, or the parts, of a field that is a tuple: the field's name and a number."""
        return tuple(f"{field}{i}" for i in range(count))

    @cached_property
    def param_names(self) -> tuple[str, ...]:
        """The names of the parameters, in the order of `params`."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """The least and the greatest value of each parameter, (P,) and (P,)."""
        return np.array([p.low for p in self.parameters]), np.array([p.high for p in self.parameters])

    @cached_property
    def prior_sigmas(self) -> Array:
        """How far from 0 each parameter (P,) is expected to be: `Parameter.prior_sigma`."""
        return np.array([p.prior_sigma for p in self.parameters])

    @cached_property
    def params(self) -> Array:
        """The parameters (P,) as one flat, read-only vector."""
        flat = np.hstack([_numbers(getattr(self, f.name)) for f in dataclasses.fields(self)])  # pyright: ignore[reportArgumentType]
        flat.flags.writeable = False
        return flat

    def with_params(self, params: ArrayLike) -> Self:
        """Give the same with other parameters (P,)."""
        vector = np.asarray(params, float)
        if vector.shape != self.params.shape:
            raise ValueError(f"{self.name} has {self.params.size} parameters, got an array of shape {vector.shape}")
        values, start = {}, 0
        for field in dataclasses.fields(self):  # pyright: ignore[reportArgumentType]
            old = getattr(self, field.name)
            stop = start + (1 if isinstance(old, float) else _numbers(old).size)
            values[field.name] = _with_numbers(old, vector[start:stop])
            start = stop
        made = dataclasses.replace(self, **values)  # pyright: ignore[reportArgumentType]
        # What is known of the parameters stays the same: solvers ask at every step.
        made.__dict__.update(
            {name: getattr(self, name) for name in ("parameters", "param_names", "bounds", "prior_sigmas")}
        )
        return made

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Give the same with other values of some parameters, by name; names it lacks are passed over."""
        return self.with_params([values.get(name, value) for name, value in self.to_dict().items()])

    def to_dict(self) -> dict[str, Any]:
        """Give the parameters by name."""
        return dict(zip(self.param_names, map(float, self.params), strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
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


def _numbers(value: Any) -> Array:
    """Give the numbers of a field's value in order."""
    if isinstance(value, Parameterized):
        return value.params
    if isinstance(value, tuple) and value and isinstance(value[0], Parameterized):
        return np.hstack([part.params for part in value])
    return np.asarray(value, float).ravel()


def _with_numbers(value: Any, numbers: Array) -> Any:
    """Give a field's value with other numbers."""
    if isinstance(value, float):
        return float(numbers[0])
    if isinstance(value, Parameterized):
        return value.with_params(numbers)
    if isinstance(value, tuple) and value and isinstance(value[0], Parameterized):
        ends = np.cumsum([part.params.size for part in value])
        return tuple(part.with_params(n) for part, n in zip(value, np.split(numbers, ends[:-1]), strict=True))
    return tuple(map(float, numbers)) if isinstance(value, tuple) else float(numbers[0])

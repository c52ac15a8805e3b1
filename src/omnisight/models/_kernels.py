"""The compiled drivers: one loop for all models, resolved per model at compile time.

Imported at the first use only, because numba costs a quarter of a second. Compiled code is kept in the user's
cache folder under a hash of the sources of all models: numba itself would look at this file alone and run stale code.
"""

import inspect
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.compiler import Compiler
from numba.extending import overload, register_jitable

from omnisight.cache import cache_folder
from omnisight.compiled import cached_njit, source_hash
from omnisight.models import _branchless, _bspline, _elementwise
from omnisight.models._elementwise import FULL, ONCE, project_point, unproject_pixel

# Divisions by zero give inf, as in numpy; a fused multiply-add may round once instead of twice.
# What is not inlined keeps the loop around it from vectorising, so formulas are inlined however often they are used.
OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz", "arcp"}}
FORMULA: Any = {**OPTIONS, "forceinline": True}
# Points worked on at a time: their planes stay in the first cache.
BLOCK = 256


def _register_hooks() -> None:
    for formula in _bspline.FORMULAS:
        register_jitable(**FORMULA)(formula)

    @overload(_elementwise.where, jit_options=FORMULA)
    def _where(condition: Any, a: Any, b: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def choose(condition: Any, a: Any, b: Any) -> Any:
            return a if condition else b

        return choose

    @overload(_elementwise.span_of, jit_options=FORMULA)
    def _span_of(place: Any, count: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def span(place: Any, count: Any) -> Any:
            # 32 bits: processors convert several at a time to these alone.
            return np.int32(min(place, count - 1.0) if place > 0.0 else 0.0)

        return span

    @overload(_elementwise.settled, jit_options=FORMULA)
    def _settled(step: Any, least: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def never(step: Any, least: Any) -> Any:
            return False

        return never

    for formula in (_branchless.atan2, _branchless.sine_cosine):
        plain = getattr(_elementwise, formula.__name__)
        overload(plain, jit_options=FORMULA)(_like(plain, lambda *_, formula=formula: formula))
    for name, hook in _elementwise.HOOKS.items():
        model = attrgetter(f"instance_class.model.{name}")
        overload(hook, jit_options=FORMULA)(_like(hook, lambda m, *_, model=model: model(m)))


def _like(hook: Any, resolve: Any) -> Any:
    """Give what resolves a hook the hook's own signature, which numba asks for."""
    resolve.__signature__ = inspect.signature(hook)
    return resolve


class NoAliasCompiler(Compiler):
    """Compiles functions whose arrays overlap no other: only so what a model looks up in its tables vectorises."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.noalias = True  # pyright: ignore[reportAttributeAccessIssue]


_register_hooks()
FOLDER = cache_folder() / f"compiled-{source_hash(Path(__file__).parent, '*.py')}"


@numba.njit(**OPTIONS)
def _any_left(values: Any) -> Any:
    # NonCentralityTest first: the loop over what is left vectorises too, and would do all the work again under a mask.
    left = 0
    for value in values:
        left += np.abs(value) == np.inf
    return left > 0


@numba.njit(pipeline_class=NoAliasCompiler, **OPTIONS)
def _project_block(m: Any, x: Any, y: Any, z: Any, u: Any, v: Any) -> None:
    # Planes of x, y, z and no branch: this loop vectorises, the interleaved arrays of the callers would not.
    for j in range(x.shape[0]):
        a, b, ok = project_point(m, x[j], y[j], z[j], ONCE)
        u[j] = a if ok or np.abs(a) == np.inf else np.nan
        v[j] = b if ok else np.nan
    if not _any_left(u):
        return
    for j in range(x.shape[0]):
        if np.abs(u[j]) == np.inf:
            a, b, ok = project_point(m, x[j], y[j], z[j], FULL)
            ok = ok and np.abs(a) != np.inf
            u[j] = a if ok else np.nan
            v[j] = b if ok else np.nan


@numba.njit(pipeline_class=NoAliasCompiler, **OPTIONS)
def _unproject_block(m: Any, u: Any, v: Any, x: Any, y: Any, z: Any) -> None:
    for j in range(u.shape[0]):
        a, b, c, ok = unproject_pixel(m, u[j], v[j], ONCE)
        x[j] = a if ok or np.abs(a) == np.inf else np.nan
        y[j] = b if ok else np.nan
        z[j] = c if ok else np.nan
    if not _any_left(x):
        return
    for j in range(u.shape[0]):
        if np.abs(x[j]) == np.inf:
            a, b, c, ok = unproject_pixel(m, u[j], v[j], FULL)
            ok = ok and np.abs(a) != np.inf
            x[j] = a if ok else np.nan
            y[j] = b if ok else np.nan
            z[j] = c if ok else np.nan


def project(m: Any, points: Any, pixels: Any, valid: Any, first: int, last: int) -> None:
    """Fill rows first to last of pixels (N, 2) and valid (N,) from points (N, 3); NaN where not valid."""
    planes = np.empty((5, BLOCK))
    for start in range(first, last, BLOCK):
        size = min(BLOCK, last - start)
        x, y, z, u, v = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size], planes[4, :size]
        given, found, shown = points[start : start + size], pixels[start : start + size], valid[start : start + size]
        for j in range(size):
            x[j], y[j], z[j] = given[j, 0], given[j, 1], given[j, 2]
        _project_block(m, x, y, z, u, v)
        for j in range(size):
            found[j, 0], found[j, 1] = u[j], v[j]
            shown[j] = u[j] == u[j]


def unproject(m: Any, pixels: Any, bearings: Any, valid: Any, first: int, last: int) -> None:
    """Fill rows first to last of bearings (N, 3) and valid (N,) from pixels (N, 2); NaN where not valid."""
    planes = np.empty((5, BLOCK))
    for start in range(first, last, BLOCK):
        size = min(BLOCK, last - start)
        x, y, z, u, v = planes[0, :size], planes[1, :size], planes[2, :size], planes[3, :size], planes[4, :size]
        given, found, shown = pixels[start : start + size], bearings[start : start + size], valid[start : start + size]
        for j in range(size):
            u[j], v[j] = given[j, 0], given[j, 1]
        _unproject_block(m, u, v, x, y, z)
        for j in range(size):
            found[j, 0], found[j, 1], found[j, 2] = x[j], y[j], z[j]
            shown[j] = x[j] == x[j]


def map_view(target: Any, source: Any, rotation: Any, map_u: Any, map_v: Any, first: int, last: int) -> None:
    """Fill rows first to last of map_u, map_v (H, W): where the target's pixel is in the source, NaN if nowhere.

    `rotation` (3, 3) turns bearings of the target into the source's frame.
    """
    columns = map_u.shape[1]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for row in range(first, last):
        us, vs = map_u[row], map_v[row]
        for column in range(columns):
            x, y, z, ok = unproject_pixel(target, float(column), float(row), ONCE)
            a, b, c = r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z
            u, v, seen = project_point(source, a, b, c, ONCE)
            shown = u if ok & seen else np.nan
            us[column] = np.inf if (np.abs(x) == np.inf) | (np.abs(u) == np.inf) else shown
            vs[column] = v if ok & seen else np.nan
        if not _any_left(us):
            continue
        for column in range(columns):
            if us[column] == np.inf:
                x, y, z, ok = unproject_pixel(target, float(column), float(row), FULL)
                a, b, c = r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z
                u, v, seen = project_point(source, a, b, c, FULL)
                us[column] = u if ok & seen else np.nan
                vs[column] = v if ok & seen else np.nan


@cache
def compiled(loop: str, *models: str) -> Any:
    """Give one of the loops above (project, unproject, map_view), compiled for models by name or kept from before.

    Each has a folder of its own: a process that needs one model does not read what was kept of all.
    """
    return cached_njit(globals()[loop], FOLDER / "-".join(models), nogil=True, **OPTIONS)

"""The compiled, parallel drivers: one loop for all models, resolved per model at compile time.

Imported at the first use only, because numba costs a quarter of a second. Compiled code is kept in the user's
cache folder under a hash of the sources of all models: numba itself would look at this file alone and run stale code.
"""

import hashlib
import inspect
import threading
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import config
from numba.extending import overload, register_jitable

from omnisight.cache import cache_folder
from omnisight.models import _elementwise
from omnisight.models._elementwise import project_point, unproject_pixel

# Divisions by zero give inf, as in numpy; a fused multiply-add may round once instead of twice.
OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz", "arcp"}}
# numba's portable threading layer must not be entered by two Python threads at once.
LOCK = threading.Lock()


def _sources() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _register_hooks() -> None:
    register_jitable(**OPTIONS)(_elementwise.atan2)
    register_jitable(**OPTIONS)(_elementwise.sine_cosine)

    @overload(_elementwise.where, jit_options=OPTIONS)
    def _where(condition: Any, a: Any, b: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def choose(condition: Any, a: Any, b: Any) -> Any:
            return a if condition else b

        return choose

    @overload(_elementwise.settled, jit_options=OPTIONS)
    def _settled(step: Any, least: Any) -> Any:  # pyright: ignore[reportUnusedFunction]
        def small(step: Any, least: Any) -> Any:
            return np.abs(step) <= least

        return small

    for name, hook in _elementwise.HOOKS.items():
        overload(hook, jit_options=OPTIONS)(_resolver(name, hook))


def _resolver(name: str, hook: Any) -> Any:
    def resolve(*arguments: Any) -> Any:
        return getattr(arguments[0].instance_class.model, name)

    resolve.__signature__ = inspect.signature(hook)  # pyright: ignore[reportFunctionMemberAccess]
    return resolve


_register_hooks()
config.CACHE_DIR = str(cache_folder() / f"compiled-{_sources()}")  # pyright: ignore[reportAttributeAccessIssue]


@numba.njit(parallel=True, cache=True, **OPTIONS)
def project(m: Any, points: Any, pixels: Any, valid: Any) -> None:
    """Fill pixels (N, 2) and valid (N,) from points (N, 3); NaN where not valid."""
    for i in numba.prange(points.shape[0]):
        u, v, ok = project_point(m, points[i, 0], points[i, 1], points[i, 2])
        pixels[i, 0] = u if ok else np.nan
        pixels[i, 1] = v if ok else np.nan
        valid[i] = ok


@numba.njit(parallel=True, cache=True, **OPTIONS)
def unproject(m: Any, pixels: Any, bearings: Any, valid: Any) -> None:
    """Fill bearings (N, 3) and valid (N,) from pixels (N, 2); NaN where not valid."""
    for i in numba.prange(pixels.shape[0]):
        x, y, z, ok = unproject_pixel(m, pixels[i, 0], pixels[i, 1])
        bearings[i, 0] = x if ok else np.nan
        bearings[i, 1] = y if ok else np.nan
        bearings[i, 2] = z if ok else np.nan
        valid[i] = ok


@numba.njit(parallel=True, cache=True, **OPTIONS)
def map_view(target: Any, source: Any, rotation: Any, map_u: Any, map_v: Any) -> None:
    """Fill map_u, map_v (H, W): where the pixel of the target is seen in the source; NaN where it is not.

    `rotation` (3, 3) turns bearings of the target into the source's frame.
    """
    rows, columns = map_u.shape
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for row in numba.prange(rows):
        for column in range(columns):
            x, y, z, ok = unproject_pixel(target, float(column), float(row))
            u, v, seen = project_point(
                source,
                r00 * x + r01 * y + r02 * z,
                r10 * x + r11 * y + r12 * z,
                r20 * x + r21 * y + r22 * z,
            )
            ok = ok and seen
            map_u[row, column] = u if ok else np.nan
            map_v[row, column] = v if ok else np.nan


config.CACHE_DIR = ""  # pyright: ignore[reportAttributeAccessIssue]

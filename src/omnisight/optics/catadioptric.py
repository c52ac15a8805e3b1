"""Catadioptric cameras: a lens and one or more mirrors, traced exactly."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.geometry.rays import Rays
from omnisight.models import CameraModel, model_class
from omnisight.models._arrays import as_rows, with_leading_shape
from omnisight.models._parameter import finite
from omnisight.models._projector import Array
from omnisight.optics import fermat
from omnisight.optics.mirrors import mirror_class
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.ray_model import RayModel
from omnisight.optics.seed_rays import SeedRays
from omnisight.optics.telecentric import Telecentric
from omnisight.optics.tracing import is_unobstructed, trace

# Rays per block: the intermediate arrays stay in the cache.
BLOCK_RAYS = 16384
# Start points tried for a reflection if the best one fails.
MAX_STARTS = 16
# Rings and spokes of the seed rays: a few for most points, many for the rest.
COARSE_SEEDS, FINE_SEEDS = (6, 12), (40, 96)
# Products of larger coordinates overflow.
MAX_DISTANCE = 1e150
POSE = ("tilt_x", "tilt_y", "tx", "ty", "tz")


@dataclass(frozen=True)
class Catadioptric(RayModel):
    """A lens and the mirrors it looks into: one, or several for a folded camera, in the order of the light path.

    The camera frame is that of the lens: z points forward, into the first mirror. Rays start on the last mirror.
    Mirrors are opaque: a ray that any mirror blocks, between lens and first mirror or between last mirror and scene, is
    not valid. A lens that looks through a mirror needs a `hole` there. If a concave mirror shows a scene point more
    than once, `project` returns one of its images.

    The parameters are those of the lens by their names, then those of each mirror and its pose as `mirror_radius`,
    `mirror_tilt_x`, `mirror_tz` (`mirror2_...` for the second). Shape parameters are fixed by default, because they are
    known from the drawing.
    """

    lens: CameraModel | Telecentric
    mirrors: tuple[PlacedMirror, ...]

    def __post_init__(self) -> None:
        """Check that there is a mirror."""
        if not self.mirrors or not all(isinstance(p, PlacedMirror) for p in self.mirrors):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ValueError(f"mirrors must be one or more PlacedMirror mirrors, got {self.mirrors!r}")

    @classmethod
    def example(cls) -> Self:
        from omnisight.models.pinhole import Pinhole
        from omnisight.optics.mirrors.conic import Conic

        lens = Pinhole(fx=1300.0, fy=1300.0, cx=639.5, cy=479.5)
        mirror = Conic.hyperbola(a=0.028, c=0.0385, rim=0.035)
        return cls(lens, (PlacedMirror(mirror, tilt_x=0.01, tilt_y=-0.02, tx=0.0004, ty=-0.0003, tz=0.08),))

    # -- rays ---------------------------------------------------------------------------------------------------

    def rays(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels.

        Parameters
        ----------
        pixels
            (..., 2).

        Returns
        -------
        Points on the last mirror and directions in the lens frame. Not valid are pixels outside the domain of the lens,
        and rays that miss a mirror or that a mirror blocks.
        """
        flat, lead = as_rows(pixels, 2, "pixels")
        result = Rays(np.empty((len(flat), 3)), np.empty((len(flat), 3)), np.empty(len(flat), np.bool_))
        for first in range(0, len(flat), BLOCK_RAYS):
            part = slice(first, first + BLOCK_RAYS)
            for whole, traced in zip(result, self._rays(flat[part]), strict=True):
                whole[part] = traced
        return Rays(result.origins.reshape(*lead, 3), result.bearings.reshape(*lead, 3), result.valid.reshape(lead))

    def _rays(self, pixels: Array) -> Rays:
        if isinstance(self.lens, Telecentric):
            return trace(self.mirrors, self.lens.rays(pixels))
        bearings, valid = self.lens.unproject(pixels)
        return trace(self.mirrors, Rays(np.zeros_like(bearings), bearings, valid))

    # -- points -------------------------------------------------------------------------------------------------

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the lens frame via the mirrors.

        Parameters
        ----------
        points
            (..., 3), in the unit of the mirrors.

        Returns
        -------
        pixels
            (..., 2), NaN where not valid.
        valid
            (...), whether the mirrors show the point and the lens sees its reflection.
        """
        flat, lead = as_rows(points, 3, "points")
        corners, valid = self._reflections(flat)
        pixels, in_domain = self.lens.project(corners[0].T)
        valid = valid & in_domain
        return np.where(valid[:, None], pixels, np.nan).reshape(*lead, 2), valid.reshape(lead)

    def reflection_points(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Compute where light from points is reflected.

        Parameters
        ----------
        points
            (..., 3) in the lens frame.

        Returns
        -------
        reflections
            (..., M, 3) on each of M mirrors, in the lens frame, in the order of `mirrors`; NaN where not valid.
        valid
            (...), whether the mirrors show the point. The reflection may be outside the domain of the lens.
        """
        flat, lead = as_rows(points, 3, "points")
        corners, valid = self._reflections(flat)
        reflections = np.where(valid[:, None, None], np.stack(corners).transpose(2, 0, 1), np.nan)
        return reflections.reshape(*lead, len(self.mirrors), 3), valid.reshape(lead)

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points; return pixels, valid, d_point (..., 2, 3) and d_params (..., 2, P).

        The derivatives follow from the implicit function theorem applied to Fermat's principle dL/du = 0: with H =
        d2L/du2, du/dX = -H^-1 d2L/du dX and du/dp = -H^-1 d2L/du dp. Only d2L/du dp uses central differences (of the
        gradient, not of a solution). Rim and hole affect only `valid`; their derivatives are 0.
        """
        flat, lead = as_rows(points, 3, "points")
        u, valid = self._solve(flat)
        with np.errstate(all="ignore"):
            path = fermat.path(self.mirrors, self._parallel, u, flat.T)
            pixels, in_domain, d_corner, d_lens = self.lens.project_with_jacobians(path.corners[0].T)
            d_chart = path.tangents[0].transpose(2, 1, 0)  # (N, 3, 2), d corner / d u_1
            d_point = d_corner @ d_chart @ fermat.derivatives_by_point(path)
            d_mirrors = d_corner @ fermat.derivatives_by_parameters(self.mirrors, self._parallel, u, flat.T, path)
        valid = valid & in_domain
        d_params = np.concatenate([d_lens, d_mirrors], -1)
        return with_leading_shape(lead, pixels, valid, d_point, d_params)

    def _reflections(self, points: Array) -> tuple[list[Array], NDArray[np.bool_]]:
        """Return the reflection points (3, N) of points (N, 3) on each mirror, and which paths are valid."""
        u, valid = self._solve(points)
        with np.errstate(all="ignore"):
            return fermat.path(self.mirrors, self._parallel, u, points.T).corners[:-1], valid

    def _solve(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the reflection points (2 M, N) of points (N, 3), NaN where not valid, and validity (N,).

        A point is resolved when a valid path is found or shown not to exist. Start points are tried in order of rank;
        each pass works on the points that are still unresolved.
        """
        solution, valid = np.full((2 * len(self.mirrors), len(points)), np.nan), np.zeros(len(points), np.bool_)
        with np.errstate(all="ignore"):
            resolved = ~((points**2).sum(-1) < MAX_DISTANCE**2)
            for seeds, count in zip(self._seeds, (1, MAX_STARTS), strict=True):
                if not len(open_points := np.flatnonzero(~resolved)):
                    break
                candidates, near = seeds.nearest(points[open_points], count)
                resolved[open_points[~near.any(0)]] = True
                for start, is_near in zip(candidates, near, strict=True):
                    tried = is_near & ~resolved[open_points]
                    initial, index = seeds.u[:, start[tried]], open_points[tried]
                    for first in range(0, len(index), BLOCK_RAYS // 4):
                        part = slice(first, first + BLOCK_RAYS // 4)
                        targets = points[index[part]].T
                        u, converged = fermat.stationary(self.mirrors, self._parallel, initial[:, part], targets)
                        u, reached = u[:, converged], index[part][converged]
                        visible = self._is_reflection(u, points[reached])
                        solution[:, reached[visible]], valid[reached[visible]] = u[:, visible], True
                        resolved[reached] = visible
                        resolved[reached[~visible]] = self._proves_hidden(u[:, ~visible], points[reached[~visible]])
        return solution, valid

    def _proves_hidden(self, u: Array, points: Array) -> NDArray[np.bool_]:
        """Return which stationary paths (2 M, N) that are no valid reflection prove that the point is hidden.

        |P - C| + |X - P| is a convex function of P. On the boundary of a convex body its only minimum is the
        reflection, or the straight segment through the body. If the stationary path found is beyond the rim or passes
        straight through, there is no other reflection.
        """
        mirror = self.mirrors[0].mirror
        if len(self.mirrors) > 1 or not mirror.convex:
            return np.zeros(len(points), np.bool_)
        path = fermat.path(self.mirrors, self._parallel, u, points.T)
        normal = np.cross(path.tangents[0][1], path.tangents[0][0], axis=0)
        # A maximum of the length, a reflection from inside the body, proves nothing.
        outside = ((path.legs[0] - path.legs[1]) * normal).sum(0) <= 1e-9 * np.sqrt((normal**2).sum(0))
        return outside & mirror.on_sheet(*u)

    def _is_reflection(self, u: Array, points: Array) -> NDArray[np.bool_]:
        """Return which stationary paths (2 M, N) to points (N, 3) reflect on existing, unobstructed mirror surface."""
        path = fermat.path(self.mirrors, self._parallel, u, points.T)
        visible = np.ones(u.shape[1], np.bool_)
        first = path.corners[0]
        start = first * np.array([[1.0], [1.0], [0.0]]) if self._parallel else np.zeros_like(first)
        previous = None
        for i, p in enumerate(self.mirrors):
            normal = np.cross(path.tangents[i][1], path.tangents[i][0], axis=0)
            arriving, leaving = path.legs[i], path.legs[i + 1]
            visible &= p.mirror.contains(*u[2 * i : 2 * i + 2])
            visible &= ((arriving * normal).sum(0) < 0) & ((leaving * normal).sum(0) > 0)
            length = np.sqrt(((path.corners[i] - start) ** 2).sum(0))
            bearings = np.broadcast_to(arriving, start.shape).T
            visible &= is_unobstructed(self.mirrors, start.T, bearings, length, previous, p)
            start, previous = path.corners[i], p
        infinite = np.full(len(visible), np.inf)
        return visible & is_unobstructed(self.mirrors, start.T, path.legs[-1].T, infinite, previous)

    @cached_property
    def _seeds(self) -> tuple[SeedRays, SeedRays]:
        """Start points: a few, and many for the points that these do not resolve."""
        coarse, fine = (SeedRays.trace(self.mirrors, self._parallel, *n) for n in (COARSE_SEEDS, FINE_SEEDS))
        return coarse, fine

    @property
    def _parallel(self) -> bool:
        return isinstance(self.lens, Telecentric)

    # -- files --------------------------------------------------------------------------------------------------

    @staticmethod
    def coefficient_names(count: int, field: str) -> tuple[str, ...]:
        """Return the names of the mirrors: mirror, mirror2, ..."""
        return tuple(f"mirror{i + 1 if i else ''}" for i in range(count))

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters by name, and the model names of `lens`, `mirror`, `mirror2`, ...

        Infinite values (the rim of an unbounded mirror) are omitted, because files cannot hold them.
        """
        kinds = {"lens": self.lens.name}
        names = self.coefficient_names(len(self.mirrors), "mirrors")
        kinds |= {name: p.mirror.name for name, p in zip(names, self.mirrors, strict=True)}
        return kinds | {name: value for name, value in super().to_dict().items() if np.isfinite(value)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make the camera from the result of `to_dict`.

        Raises
        ------
        ValueError
            If the lens, a mirror or a parameter is missing or unknown, or a value is not a number.
        """
        if missing := sorted({"lens", "mirror"} - set(values)):
            raise ValueError(f"model {cls.name}: missing {', '.join(missing)}")
        count = 1 + sum(name[6:].isdecimal() for name in values if name.startswith("mirror"))
        rest = {name: value for name, value in values.items() if name != "lens"}
        placed: list[PlacedMirror] = []
        for name in cls.coefficient_names(count, "mirrors"):
            if name not in rest:
                raise ValueError(f"model {cls.name}: missing {name}")
            shape = mirror_class(rest.pop(name))
            own = {n.removeprefix(f"{name}_"): rest.pop(n) for n in list(rest) if n.startswith(f"{name}_")}
            pose = {n: finite(own.pop(n), f"{name}_{n}") for n in POSE if n in own}
            placed.append(PlacedMirror(shape.from_dict(own), **pose))
        lens = Telecentric if values["lens"] == Telecentric.name else model_class(values["lens"])
        return cls(lens.from_dict(rest), tuple(placed))

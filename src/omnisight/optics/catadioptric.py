"""A camera that looks into mirrors."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.models._projector import Array
from omnisight.geometry.rays import Rays
from omnisight.models import CameraModel, model_class
from omnisight.models._parameter import finite
from omnisight.models._protocol import rows, shaped
from omnisight.optics import fermat
from omnisight.optics.mirrors import mirror_class
from omnisight.optics.placed_mirror import PlacedMirror
from omnisight.optics.ray_model import RayModel
from omnisight.optics.seed_rays import SeedRays
from omnisight.optics.telecentric import Telecentric
from omnisight.optics.tracing import free, trace

# Rays worked on at a time: what they need stays in the cache.
BLOCK = 16384
# Starts from which a reflection is looked for where the first does not lead to one.
TRIED = 16
# Points farther off have no place: products of their coordinates are no numbers.
FARTHEST = 1e150
# What the lens's model is called where it is no central one; "orthographic" is a fisheye.
TELECENTRIC = "telecentric"
POSE = ("tilt_x", "tilt_y", "tx", "ty", "tz")


@dataclass(frozen=True)
class Catadioptric(RayModel):
    """A lens and the mirrors it looks into, one or (folded) more, in the order in which it sees them.

    The frame is the lens's: z forward, into the first mirror. A ray begins on the last mirror. No mirror is
    transparent: what any of them hides is not valid, from the lens to the first as from the last to the world; a lens
    that looks through a mirror needs a `hole` there. Of a scene point that a concave mirror shows more than once, one
    image is given.

    Its parameters are the lens's by their names, then each mirror's and its pose's as `mirror_radius`, `mirror_tilt_x`,
    `mirror_tz` (`mirror2_...` of the second). Shapes are not free unless asked for: drawings know them.
    """

    lens: CameraModel | Telecentric
    mirrors: tuple[PlacedMirror, ...]

    def __post_init__(self) -> None:
        """Refuse a lens without a mirror."""
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
        """Give the rays of pixels.

        Parameters
        ----------
        pixels
            (..., 2).

        Returns
        -------
        Where each leaves the last mirror and in which direction, in the lens's frame. Not valid is what the lens does
        not show, what misses a mirror, and what a mirror hides.
        """
        flat, lead = rows(pixels, 2, "pixels")
        found = Rays(np.empty((len(flat), 3)), np.empty((len(flat), 3)), np.empty(len(flat), np.bool_))
        for first in range(0, len(flat), BLOCK):
            part = slice(first, first + BLOCK)
            for whole, traced in zip(found, self._rays(flat[part]), strict=True):
                whole[part] = traced
        return Rays(found.origins.reshape(*lead, 3), found.bearings.reshape(*lead, 3), found.valid.reshape(lead))

    def _rays(self, pixels: Array) -> Rays:
        if isinstance(self.lens, Telecentric):
            return trace(self.mirrors, self.lens.rays(pixels))
        bearings, valid = self.lens.unproject(pixels)
        return trace(self.mirrors, Rays(np.zeros_like(bearings), bearings, valid))

    # -- points -------------------------------------------------------------------------------------------------

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points of the lens's frame over the mirrors.

        Parameters
        ----------
        points
            (..., 3), in the unit of the mirrors.

        Returns
        -------
        pixels
            (..., 2), NaN where not valid.
        valid
            (...), whether the mirrors show the point and the lens shows where they do.
        """
        flat, lead = rows(points, 3, "points")
        corners, valid = self._reflections(flat)
        pixels, seen = self.lens.project(corners[0].T)
        valid = valid & seen
        return np.where(valid[:, None], pixels, np.nan).reshape(*lead, 2), valid.reshape(lead)

    def reflection_points(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Give where light of the points meets the mirrors.

        Parameters
        ----------
        points
            (..., 3) of the lens's frame.

        Returns
        -------
        reflections
            (..., M, 3) on each mirror, in the lens's frame and the order in which the lens sees them; NaN where not
            valid.
        valid
            (...), whether the mirrors show the point, be it outside what the lens shows.
        """
        flat, lead = rows(points, 3, "points")
        corners, valid = self._reflections(flat)
        found = np.where(valid[:, None, None], np.stack(corners).transpose(2, 0, 1), np.nan)
        return found.reshape(*lead, len(self.mirrors), 3), valid.reshape(lead)

    def project_with_jacobians(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """Project points and differentiate: pixels, valid, d_point (..., 2, 3) and d_params (..., 2, P).

        By the implicit function theorem on Fermat's principle, dL/du = 0: with H = d2L/du2, du/dX = -H^-1 d2L/du dX,
        and du/dp = -H^-1 d2L/du dp, in which alone d/dp is a central difference, of the gradient and not of a solution.
        The rim and the hole change nothing but what is valid.
        """
        flat, lead = rows(points, 3, "points")
        u, valid = self._solve(flat)
        with np.errstate(all="ignore"):
            path = fermat.path(self.mirrors, self._parallel, u, flat.T)
            pixels, seen, d_corner, d_lens = self.lens.project_with_jacobians(path.corners[0].T)
            slide = path.tangents[0].transpose(2, 1, 0)  # (N, 3, 2), d corner / d u_1
            d_point = d_corner @ slide @ fermat.by_point(path)
            d_mirrors = d_corner @ fermat.by_parameters(self.mirrors, self._parallel, u, flat.T, path)
        valid = valid & seen
        d_params = np.concatenate([d_lens, d_mirrors], -1)
        return shaped(lead, pixels, valid, d_point, d_params)

    def _reflections(self, points: Array) -> tuple[list[Array], NDArray[np.bool_]]:
        """Give the corners (3, N) of the paths of points (N, 3), and which of them light can take."""
        u, valid = self._solve(points)
        with np.errstate(all="ignore"):
            return fermat.path(self.mirrors, self._parallel, u, points.T).corners[:-1], valid

    def _solve(self, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Give where (2 M, N) light of points (N, 3) meets the mirrors, NaN where not valid, and which is (N,)."""
        found, valid = np.full((2 * len(self.mirrors), len(points)), np.nan), np.zeros(len(points), np.bool_)
        with np.errstate(all="ignore"):
            known = ~((points**2).sum(-1) < FARTHEST**2)
            for seeds, count in zip(self._seeds, (1, TRIED), strict=True):
                if not len(rest := np.flatnonzero(~known)):
                    break
                which, near = seeds.nearest(points[rest], count)
                known[rest[~near.any(0)]] = True
                for start, likely in zip(which, near, strict=True):
                    tried = likely & ~known[rest]
                    begin, goal = seeds.u[:, start[tried]], rest[tried]
                    for first in range(0, len(goal), BLOCK // 4):
                        part = slice(first, first + BLOCK // 4)
                        u, there = fermat.stationary(self.mirrors, self._parallel, begin[:, part], points[goal[part]].T)
                        u, reached = u[:, there], goal[part][there]
                        shown = self._shown(u, points[reached])
                        found[:, reached[shown]], valid[reached[shown]] = u[:, shown], True
                        known[reached] = shown
                        known[reached[~shown]] = self._hidden(u[:, ~shown], points[reached[~shown]])
        return found, valid

    def _hidden(self, u: Array, points: Array) -> NDArray[np.bool_]:
        """Say of which points (N, 3) the stationary paths (2 M, N) that do not show them prove that nothing does.

        |P - C| + |X - P| is a convex function of P. Over what is behind a convex mirror a reflection is its minimum, or
        else all that lies straight between: found past the rim, or straight through, there is no other.
        """
        mirror = self.mirrors[0].mirror
        if len(self.mirrors) > 1 or not mirror.convex:
            return np.zeros(len(points), np.bool_)
        path = fermat.path(self.mirrors, self._parallel, u, points.T)
        normal = np.cross(path.tangents[0][1], path.tangents[0][0], axis=0)
        # A mirror image seen from within, the length's maximum, proves nothing.
        outside = ((path.legs[0] - path.legs[1]) * normal).sum(0) <= 1e-9 * np.sqrt((normal**2).sum(0))
        return outside & mirror.on_sheet(*u)

    def _shown(self, u: Array, points: Array) -> NDArray[np.bool_]:
        """Say which paths (2 M, N) to points (N, 3) are reflections on mirrors that are there, with nothing between."""
        path = fermat.path(self.mirrors, self._parallel, u, points.T)
        shown = np.ones(u.shape[1], np.bool_)
        first = path.corners[0]
        last = first * np.array([[1.0], [1.0], [0.0]]) if self._parallel else np.zeros_like(first)
        before = None
        for i, p in enumerate(self.mirrors):
            normal = np.cross(path.tangents[i][1], path.tangents[i][0], axis=0)
            arriving, leaving = path.legs[i], path.legs[i + 1]
            shown &= p.mirror.contains(*u[2 * i : 2 * i + 2])
            shown &= ((arriving * normal).sum(0) < 0) & ((leaving * normal).sum(0) > 0)
            length = np.sqrt(((path.corners[i] - last) ** 2).sum(0))
            bearings = np.broadcast_to(arriving, last.shape).T
            shown &= free(self.mirrors, last.T, bearings, length, before, p)
            last, before = path.corners[i], p
        return shown & free(self.mirrors, last.T, path.legs[-1].T, np.full(len(shown), np.inf), before)

    @cached_property
    def _seeds(self) -> tuple[SeedRays, SeedRays]:
        """Rays to begin from: a few, and many for the points that these do not find."""
        return tuple(SeedRays.of(self.mirrors, self._parallel, *n) for n in ((6, 12), (40, 96)))  # pyright: ignore[reportReturnType]

    @property
    def _parallel(self) -> bool:
        return isinstance(self.lens, Telecentric)

    # -- files --------------------------------------------------------------------------------------------------

    @staticmethod
    def coefficient_names(count: int, field: str) -> tuple[str, ...]:
        """Name the mirrors."""
        return tuple(f"mirror{i + 1 if i else ''}" for i in range(count))

    def to_dict(self) -> dict[str, Any]:
        """Give the parameters by name, and by `lens`, `mirror`, `mirror2` ... what they are parameters of.

        A mirror without a rim has none here either: files hold no infinite number.
        """
        kinds = {"lens": TELECENTRIC if isinstance(self.lens, Telecentric) else self.lens.name}
        names = self.coefficient_names(len(self.mirrors), "mirrors")
        kinds |= {name: p.mirror.name for name, p in zip(names, self.mirrors, strict=True)}
        return kinds | {name: value for name, value in super().to_dict().items() if np.isfinite(value)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make the camera from what `to_dict` gives.

        Raises
        ------
        ValueError
            If the lens or a mirror is missing or unknown, a name is, or a value is no number.
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
        lens = Telecentric if values["lens"] == TELECENTRIC else model_class(values["lens"])
        return cls(lens.from_dict(rest), tuple(placed))

"""The boards of a calibration as flat arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.targets import Detections

Array = NDArray[np.float64]

# Corners of a view that are always kept: a pose needs some.
FEW = 12


@dataclass(frozen=True)
class Observations:
    """Corners of boards seen in images, all of them in one array.

    Attributes
    ----------
    points
        (N, 3) corners in the frame of their board: in z = 0, or anywhere on a rigid body.
    pixels
        (N, 2) where they are seen.
    covariance
        (N, 2, 2) of `pixels`, px^2; zero where it is not known.
    groups
        One slice of the rows per view: a board in an image.
    names
        One name per view.
    extent
        (2, 2) least and greatest (x, y) of the board: what `bows` are relative to.
    """

    points: Array
    pixels: Array
    covariance: Array
    groups: tuple[slice, ...]
    names: tuple[str, ...]
    extent: Array

    @classmethod
    def of(
        cls,
        views: Sequence[Sequence[ArrayLike]],
        names: Sequence[str] | None = None,
        extent: ArrayLike | None = None,
    ) -> Self:
        """Join views, each (points (n, 3), pixels (n, 2)) or (points, pixels, covariance (n, 2, 2)).

        Points may be (n, 2), on the plane z = 0, and both may be lists, of any real type, or (n, 1, k) or (1, n, k) as
        OpenCV writes them. The extent is that of all corners unless told otherwise.

        Raises
        ------
        ValueError
            If a view's arrays do not fit together, are empty, or are not finite, or a covariance is none.
        """
        names = tuple(names) if names is not None else tuple(f"view {i}" for i in range(len(views)))
        points, pixels, covariance = [np.zeros((0, 3))], [np.zeros((0, 2))], [np.zeros((0, 2, 2))]
        groups, start = list[slice](), 0
        for name, (view_points, view_pixels, *rest) in zip(names, views, strict=True):
            x, p = (_rows(values, name) for values in (view_points, view_pixels))
            c = np.asarray(rest[0], float) if rest else np.zeros((len(x), 2, 2))
            if x.ndim != 2 or x.shape[1] not in (2, 3) or p.shape != (len(x), 2):
                got = f"{np.shape(view_points)} and {np.shape(view_pixels)}"
                raise ValueError(f"{name}: needs points (n, 3) or (n, 2) and pixels (n, 2), got {got}")
            if not len(x):
                raise ValueError(f"{name}: has no corners; leave it out")
            if c.shape != (len(x), 2, 2):
                raise ValueError(f"{name}: needs a covariance (n, 2, 2), got {c.shape} with {len(x)} corners")
            if not (finite := np.isfinite(x).all(1) & np.isfinite(p).all(1) & np.isfinite(c).all((1, 2))).all():
                k = int(np.argmin(finite))
                raise ValueError(
                    f"{name}: a corner is not a finite number: row {k}, point {x[k].tolist()}, pixel {p[k].tolist()};"
                    " leave out corners that were not seen"
                )
            if (wrong := ~_covariances(c)).any():
                k = int(np.argmax(wrong))
                raise ValueError(
                    f"{name}: row {k}: {c[k].tolist()} is no covariance: not symmetric, or below 0 one way"
                )
            if x.shape[1] == 2:
                x = np.concatenate([x, np.zeros((len(x), 1))], 1)
            points.append(x)
            pixels.append(p)
            covariance.append(c)
            groups.append(slice(start, start + len(x)))
            start += len(x)
        corners = np.concatenate(points)
        if extent is None:
            extent = [corners[:, :2].min(0), corners[:, :2].max(0)] if len(corners) else np.zeros((2, 2))
        joined = corners, np.concatenate(pixels), np.concatenate(covariance)
        return cls(*joined, tuple(groups), names, np.asarray(extent, float))

    @classmethod
    def of_search(cls, search: Detections, names: Sequence[str] | None = None) -> Self:
        """Give every board that was found, image by image; `names` are the images'.

        A board seen twice in an image gives two views, the second named `image #2`.
        """
        if search.board is None:
            return cls.of([])
        names = [picture.path.name for picture in search.images] if names is None else names
        points = search.board.points
        views = [(points[d.ids], d.pixels, d.covariance) for picture in search.images for d in picture.boards]
        labels = [
            name if k == 0 else f"{name} #{k + 1}"
            for name, picture in zip(names, search.images, strict=True)
            for k in range(len(picture.boards))
        ]
        return cls.of(views, labels, [points[:, :2].min(0), points[:, :2].max(0)])

    def __len__(self) -> int:
        """Give the number of views."""
        return len(self.groups)

    @cached_property
    def planar(self) -> bool:
        """Whether all corners lie in z = 0, as those of a board do."""
        return not self.points[:, 2].any()

    @cached_property
    def across(self) -> float:
        """How far apart corners lie in the images, px."""
        return float(np.linalg.norm(np.ptp(self.pixels, axis=0))) if len(self.pixels) else 0.0

    @cached_property
    def view_of_row(self) -> NDArray[np.intp]:
        """(N,) the view of each corner."""
        return np.repeat(np.arange(len(self)), [g.stop - g.start for g in self.groups])

    @cached_property
    def bows(self) -> Array:
        """(N, 2) how far a board bent by one unit across x, or across y, stands off its plane at each corner.

        1 - x^2 and 1 - y^2 with the board between -1 and 1, as mrcal does: nought at the edges, one in the middle.
        """
        middle, half = self.extent.mean(0), np.ptp(self.extent, axis=0) / 2
        return 1 - ((self.points[:, :2] - middle) / np.where(half > 0, half, 1.0)) ** 2

    def rows(self, views: Sequence[int] | NDArray[np.intp]) -> NDArray[np.intp]:
        """Give the rows of the corners of some of the views."""
        return np.concatenate([np.arange(0), *(np.arange(self.groups[i].start, self.groups[i].stop) for i in views)])

    def subset(self, views: Sequence[int] | NDArray[np.intp]) -> Self:
        """Give some of the views."""
        counts = [self.groups[i].stop - self.groups[i].start for i in views]
        return self._of_rows(self.rows(views), counts, tuple(self.names[i] for i in views))

    def thinned(self, most: int) -> Self:
        """Give all views with about so many of the corners, evenly spaced, the outermost of each board among them."""
        if len(self.pixels) <= most:
            return self
        return self.at(self.thinned_rows(most))

    def at(self, kept: NDArray[np.intp]) -> Self:
        """Give all views with the corners of those rows alone, which ascend."""
        if len(kept) == len(self.pixels):
            return self
        return self._of_rows(kept, np.bincount(self.view_of_row[kept], minlength=len(self)).tolist(), self.names)

    def _of_rows(self, rows: NDArray[np.intp], counts: Sequence[int], names: tuple[str, ...]) -> Self:
        """Give the corners of those rows, so many for each of the views."""
        groups = tuple(slice(end - count, end) for count, end in zip(counts, accumulate(counts), strict=True))
        return replace(
            self,
            points=self.points[rows],
            pixels=self.pixels[rows],
            covariance=self.covariance[rows],
            groups=groups,
            names=names,
        )

    def thinned_rows(self, most: int) -> NDArray[np.intp]:
        """Give the rows of the corners that `thinned` keeps."""
        share = min(most / max(len(self.pixels), 1), 1.0)
        rows = [np.arange(0)]
        for group in self.groups:
            x, y = self.points[group, 0], self.points[group, 1]
            outermost = [end(side) for end in (np.argmin, np.argmax) for side in (x + y, x - y)]
            kept = min(max(round(share * len(x)), FEW), len(x))
            evenly = np.linspace(0, len(x) - 1, kept).round().astype(np.intp)
            rows.append(group.start + np.union1d(evenly, outermost))
        return np.concatenate(rows)


def _rows(values: ArrayLike, name: str) -> Array:
    """Give an array (n, k) of what may also be (n, 1, k) or (1, n, k); any other shape as it is."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: needs arrays of numbers: {error}") from None
    if array.ndim == 3 and 1 in array.shape[:2]:
        return array.reshape(-1, array.shape[2])
    return array


def _covariances(matrices: Array) -> NDArray[np.bool_]:
    """Say which of matrices (N, 2, 2) are symmetric and, up to rounding, nowhere below 0."""
    a, b, c, d = matrices.reshape(-1, 4).T
    middle, half = (a + d) / 2, np.hypot((a - d) / 2, b)
    return (np.abs(b - c) <= 1e-6 * middle) & (half <= middle * (1 + 1e-6))

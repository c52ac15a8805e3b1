"""Observed board points of all images of one camera, as flat arrays: what every stage of a calibration takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnisight.display import Displayed
from omnisight.images import ImageField
from omnisight.targets.detections import Detections, ImageDetection
from omnisight.targets.observation_checks import check_inside, check_lists, checked_size, checked_view

Array = NDArray[np.float64]

# Points of a view that thinning always keeps: a pose needs six, and some may be outliers.
MIN_POINTS_PER_VIEW = 12


class ObservedImage(NamedTuple):
    """An image, and which views and rows of the observations are from it.

    Attributes
    ----------
    name
        Display name.
    detection
        Its detection result; None if the observations came from arrays.
    views
        Views, one per board; empty if there is none.
    rows
        Rows of their points.
    """

    name: str
    detection: ImageDetection | None
    views: range
    rows: slice


@dataclass(frozen=True)
class Observations(Displayed):
    """Board points and the pixels at which they were observed, of all views of one camera.

    A view is one board in one image.

    Attributes
    ----------
    points
        (N, 3) board points in the frame of their board: in the plane z = 0, or anywhere on a rigid body.
    pixels
        (N, 2) where they were observed.
    covariance
        (N, 2, 2) of `pixels`, px^2; zero where it is unknown.
    groups
        One slice of the rows per view.
    names
        One name per view: that of its image.
    extent
        (2, 2) least and greatest (x, y) of the board, to which `warp_basis` is relative.
    size
        (width, height) of the images, px; (0, 0) if unknown.
    unit
        Unit of `points`: "m", or "squares" if the size of a square is unknown.
    field
        Image field: where the lens or mirror shows anything; None if unknown.
    detections
        Per-image detection results behind the observations; None if they came from arrays or were reduced.
    image_names
        One display name per image of `detections`.
    """

    points: Array
    pixels: Array
    covariance: Array
    groups: tuple[slice, ...]
    names: tuple[str, ...]
    extent: Array
    size: tuple[int, int] = (0, 0)
    unit: str = "squares"
    field: ImageField | None = None
    detections: Detections | None = None
    image_names: tuple[str, ...] = ()

    @classmethod
    def from_arrays(
        cls,
        board_points: Sequence[ArrayLike],
        pixels: Sequence[ArrayLike],
        covariance: Sequence[ArrayLike] | None = None,
        *,
        size: tuple[int, int],
        names: Sequence[str] | None = None,
        extent: ArrayLike | None = None,
        unit: str = "squares",
    ) -> Self:
        """Join one array of board points and one of pixels per view.

        Parameters
        ----------
        board_points
            One (n, 3) array per view, or (n, 2) for points in the plane z = 0. Arrays may also be nested lists, of any
            real type, or (n, 1, k) or (1, n, k) as OpenCV writes them.
        pixels
            One (n, 2) array per view: (u, v), the centre of the top-left pixel is (0, 0).
        covariance
            One (n, 2, 2) array per view, px^2; unknown if omitted.
        size
            (width, height) of the images, px.
        names
            One name per view; "view 0", "view 1", ... if omitted.
        extent
            (2, 2) least and greatest (x, y) of the board; those of the points if omitted.
        unit
            Unit of the board points: "m" or "squares".

        Raises
        ------
        ValueError
            If the numbers of arrays differ; if the arrays of a view do not fit together, are empty or not finite; if a
            corner lies outside the image, a board point or a pixel occurs twice in a view, or the corners of a view are
            collinear; or if a covariance is not symmetric and positive semi-definite.
        """
        check_lists(board_points, pixels, covariance)
        names = tuple(names) if names is not None else tuple(f"view {i}" for i in range(len(pixels)))
        if len(names) != len(pixels):
            raise ValueError(f"needs one name per view, got {len(names)} names and {len(pixels)} views")
        covariances = [None] * len(pixels) if covariance is None else covariance
        views = [checked_view(*arrays) for arrays in zip(names, board_points, pixels, covariances, strict=True)]
        size = checked_size(size)
        check_inside(names, [pixels for _, pixels, _ in views], size)
        x, p, c = (
            np.concatenate([empty, *parts])
            for empty, *parts in zip((np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 2, 2))), *views, strict=True)
        )
        if extent is None:
            extent = [x[:, :2].min(0), x[:, :2].max(0)] if len(x) else np.zeros((2, 2))
        groups = _slices([len(view[0]) for view in views])
        return cls(x, p, c, groups, names, np.asarray(extent, float), size, unit)

    @classmethod
    def from_detections(cls, detections: Detections, image_names: Sequence[str] | None = None) -> Self:
        """Join every detected board, image by image.

        A second board in an image is a view of its own, named `image #2`.

        Parameters
        ----------
        detections
            Detected boards.
        image_names
            One display name per image; the file names if omitted.
        """
        names = tuple(image_names or (image.path.name for image in detections.images))
        boards = [
            (name if k == 0 else f"{name} #{k + 1}", detection)
            for name, image in zip(names, detections.images, strict=True)
            for k, detection in enumerate(image.boards)
        ]
        points = np.zeros((0, 3)) if detections.board is None else detections.board.points
        observations = cls.from_arrays(
            [points[detection.ids] for _, detection in boards],
            [detection.pixels for _, detection in boards],
            [detection.covariance for _, detection in boards],
            size=detections.size,
            names=[name for name, _ in boards],
            extent=[points[:, :2].min(0), points[:, :2].max(0)] if len(points) else None,
            unit="squares" if detections.board is None else detections.board.unit,
        )
        return replace(observations, field=detections.field, detections=detections, image_names=names)

    @classmethod
    def joined(cls, boards: Mapping[str, Self]) -> Self:
        """Join the views of several boards by one camera; the name of each is followed by that of its board.

        The extent is that of the largest board.

        Raises
        ------
        ValueError
            If there is no view, or boards are in different units.
        """
        used = {board: views for board, views in boards.items() if len(views)}
        if not used:
            raise ValueError(f"none of the boards {', '.join(boards)} was detected: do their files match the images?")
        if len({views.unit for views in used.values()}) > 1:
            raise ValueError("the size of some of the boards only is known: specify it for all")
        counts = [group.stop - group.start for views in used.values() for group in views.groups]
        largest = max(used.values(), key=lambda views: views.sheet_size)
        return replace(
            largest,
            points=np.concatenate([views.points for views in used.values()]),
            pixels=np.concatenate([views.pixels for views in used.values()]),
            covariance=np.concatenate([views.covariance for views in used.values()]),
            groups=_slices(counts),
            names=tuple(f"{name} ({board})" for board, views in used.items() for name in views.names),
            detections=None,
            image_names=(),
        )

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.groups)

    def __repr__(self) -> str:
        """Summarize the observations in one line."""
        return f"Observations({len(self)} views, {len(self.pixels)} points, size={self.size}, unit={self.unit!r})"

    @cached_property
    def images(self) -> tuple[ObservedImage, ...]:
        """All images, those without a board too; one per view if there are no detection results."""
        if self.detections is None:
            images = [(name, None, 1) for name in self.names]
        else:
            detected = zip(self.image_names, self.detections.images, strict=True)
            images = [(name, image, len(image.boards)) for name, image in detected]
        starts = [*(group.start for group in self.groups), len(self.pixels)]
        ends = accumulate(count for _, _, count in images)
        return tuple(
            ObservedImage(name, image, range(end - count, end), slice(starts[end - count], starts[end]))
            for (name, image, count), end in zip(images, ends, strict=True)
        )

    @cached_property
    def is_planar(self) -> bool:
        """Whether all board points lie in the plane z = 0."""
        return not self.points[:, 2].any()

    @cached_property
    def pixel_span(self) -> float:
        """Diagonal of the bounding box of all pixels, px."""
        return float(np.linalg.norm(np.ptp(self.pixels, axis=0))) if len(self.pixels) else 0.0

    @cached_property
    def starts(self) -> NDArray[np.intp]:
        """(V + 1,) the first row of each view, and the number of rows."""
        return np.array([*(group.start for group in self.groups), len(self.pixels)], np.intp)

    @cached_property
    def view_of_row(self) -> NDArray[np.intp]:
        """(N,) the view of each point."""
        return np.repeat(np.arange(len(self)), [group.stop - group.start for group in self.groups])

    @cached_property
    def warp_basis(self) -> Array:
        """(N, 2) displacement along z at each point for a unit of board warp along x and along y.

        1 - x^2 and 1 - y^2 with the board between -1 and 1, as in mrcal: zero at the edges, one in the middle.
        """
        middle, half = self.extent.mean(0), np.ptp(self.extent, axis=0) / 2
        return 1 - ((self.points[:, :2] - middle) / np.where(half > 0, half, 1.0)) ** 2

    @cached_property
    def sheet(self) -> Array:
        """(N, 2) each point relative to the middle of the board, in units of `sheet_size`."""
        return (self.points[:, :2] - self.extent.mean(0)) / self.sheet_size

    @cached_property
    def sheet_size(self) -> float:
        """Half of the longer side of the board."""
        return float(np.ptp(self.extent, axis=0).max()) / 2 or 1.0

    def rows(self, views: Sequence[int] | NDArray[np.intp]) -> NDArray[np.intp]:
        """Return the rows of the points of some of the views."""
        return np.concatenate([np.arange(0), *(np.arange(self.groups[i].start, self.groups[i].stop) for i in views)])

    def subset(self, views: Sequence[int] | NDArray[np.intp]) -> Self:
        """Return some of the views."""
        counts = [self.groups[i].stop - self.groups[i].start for i in views]
        return self._reduced(self.rows(views), counts, tuple(self.names[i] for i in views))

    def at(self, rows: NDArray[np.intp]) -> Self:
        """Return all views with only the points of some rows, which ascend."""
        if len(rows) == len(self.pixels):
            return self
        return self._reduced(rows, np.bincount(self.view_of_row[rows], minlength=len(self)).tolist(), self.names)

    def thinned(self, count: int) -> Self:
        """Return all views with about `count` points in total, see `thinned_rows`."""
        return self if len(self.pixels) <= count else self.at(self.thinned_rows(count))

    def thinned_rows(self, count: int) -> NDArray[np.intp]:
        """Return the rows of about `count` evenly spaced points, the corners of each board's outline among them."""
        share = min(count / max(len(self.pixels), 1), 1.0)
        rows = [np.arange(0)]
        for group in self.groups:
            x, y = self.points[group, 0], self.points[group, 1]
            outermost = [end(side) for end in (np.argmin, np.argmax) for side in (x + y, x - y)]
            kept = min(max(round(share * len(x)), MIN_POINTS_PER_VIEW), len(x))
            evenly = np.linspace(0, len(x) - 1, kept).round().astype(np.intp)
            rows.append(group.start + np.union1d(evenly, outermost))
        return np.concatenate(rows)

    def _reduced(self, rows: NDArray[np.intp], counts: Sequence[int], names: tuple[str, ...]) -> Self:
        """Return the points of some rows, `counts` of them per view."""
        return replace(
            self,
            points=self.points[rows],
            pixels=self.pixels[rows],
            covariance=self.covariance[rows],
            groups=_slices(counts),
            names=names,
            detections=None,
            image_names=(),
        )


def _slices(counts: Sequence[int]) -> tuple[slice, ...]:
    return tuple(slice(end - count, end) for count, end in zip(counts, accumulate(counts), strict=True))

"""How sure a camera is of every direction that its image shows."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from omnisight.geometry import rotation as so3
from omnisight.geometry.sphere import angle_from_axis, cap, polar
from omnisight.images import ImageField
from omnisight.next_view.information_prior import InformationPrior
from omnisight.quality.uncertainty import LAST

Array = NDArray[np.float64]

RINGS, SECTORS = 18, 24
RIM = 0.995  # of the largest radius, the last ring: the very edge is a matter of rounding
# Rings over the whole field in which the best turn of the frame is summed up, and the fewest of them.
TURN_RINGS, FEWEST_RINGS = 24, 3


@dataclass(frozen=True)
class VisibleDirections:
    """Directions all over what the image shows, and what the camera's parameters do to their pixels.

    As in `Uncertainty`, the frame turns to fit best over the calibrated cone: what poses take up is no error. An image
    that reaches farther widens that cone, so the turn is had for every reach.

    Attributes
    ----------
    bearings, pixels
        (N, 3) and (N, 2).
    weight
        (N,) the share of what the image shows that each stands for; the sum is 1.
    effect, turn_effect
        (N, 2, F) and (N, 2, 3): px for each thing known of the camera, and for a turn of its frame.
    rings, turns
        (R,) reaches (radians), and (R, 3, F) the turn that fits best up to there, for each thing known.
    """

    bearings: Array
    pixels: Array
    weight: Array
    effect: Array
    turn_effect: Array
    rings: Array
    turns: Array

    @classmethod
    def of(cls, known: InformationPrior, field: ImageField | None) -> Self:
        """Ask about all that the image shows, as far as the model goes; `field` is where the lens shows anything."""
        shares = RIM * (np.arange(RINGS) + 1) / RINGS
        places, weight = places_in(known, field, shares, SECTORS)
        # The edge of the cone as well, where a calibration looks for its worst: the grid may step over it.
        bearings = np.concatenate([places, polar(np.full(SECTORS, known.reach), _around(SECTORS))])
        weight = np.append(weight, np.zeros(SECTORS))
        pixels, effect, turn_effect = effects(known, bearings)
        shown = shows(known, field, pixels) & _usable(effect, turn_effect)
        weight = weight[shown] / weight[shown].sum()
        kept = bearings[shown], pixels[shown], weight, effect[shown], turn_effect[shown]
        return cls(*kept, *_turns(known, visible_reach(known, field)))

    @property
    def theta(self) -> Array:
        """(N,) angle of each direction from the axis, radians."""
        return angle_from_axis(self.bearings)

    def errors(self, known: InformationPrior, reach: float) -> Array:
        """Give the root mean square error (N,), px, of each direction; corners reach that far from the axis."""
        return np.sqrt((self.moved(known, reach) ** 2).sum((1, 2)))

    def moved(self, known: InformationPrior, reach: float) -> Array:
        """Give by how much directions move (N, 2, F), px, when each thing known is off by its standard deviation."""
        return self._moved(known, self._ring(reach))

    def errors_with(self, known: InformationPrior, more: Array, reaches: Array) -> Array:
        """Give the errors (K, N), px, with either of several images beside.

        Parameters
        ----------
        known
            What the others tell, covariance L L^T.
        more
            (K, F, F) the information of each image.
        reaches
            (K,) how far from the axis (radians) corners are seen with it.
        """
        half = known.half
        # In units of what is known, the covariance with more information is (I + L^T more L)^-1: at most one.
        left = np.linalg.inv(np.eye(len(half)) + half.T @ more @ half)
        left = ((left + np.swapaxes(left, 1, 2)) / 2).reshape(len(more), -1)
        rings = self._ring(reaches)
        squares = np.empty((len(more), len(self.weight)))
        for ring in np.unique(rings):
            same = np.flatnonzero(rings == ring)
            moved = self._moved(known, int(ring))
            # trace(M left M^T) for all M and all `left` is one product.
            gram = (np.swapaxes(moved, 1, 2) @ moved).reshape(len(moved), -1)
            squares[same] = left[same] @ gram.T
        return np.sqrt(np.maximum(squares, 0.0))

    def errors_at(self, known: InformationPrior, bearings: Array) -> Array:
        """Give the errors (M,), px, at other directions (M, 3); NaN where the camera has no pixel."""
        _, effect, turn_effect = effects(known, bearings)
        turned = effect + turn_effect @ self.turns[self._ring(known.reach)]
        return np.sqrt(((turned @ known.half) ** 2).sum((1, 2)))

    def _moved(self, known: InformationPrior, ring: int) -> Array:
        return (self.effect + self.turn_effect @ self.turns[ring]) @ known.half

    def _ring(self, reach: Array | float) -> Any:
        return np.clip(np.searchsorted(self.rings, np.asarray(reach) * (1 + 1e-9)) - 1, 0, len(self.rings) - 1)


def places_in(known: InformationPrior, field: ImageField | None, shares: Array, sectors: int) -> tuple[Array, Array]:
    """Give bearings (N, 3) of places all over what the image shows, and the share of the image (N,) of each.

    Rings and sectors of the image, not of angles: a camera that extrapolates may squeeze many degrees, or few, into
    the part that no corner was seen in.

    Parameters
    ----------
    known, field
        The camera, and where its lens shows anything.
    shares
        (R,) radii of the rings, as shares of the largest.
    sectors
        Places around.
    """
    middle = known.camera.model.project_numpy(np.array([[0.0, 0.0, 1.0]]))[0][0]
    far = np.linalg.norm(_edge(known, field) - middle, axis=1).max()
    radius, phi = (part.ravel() for part in np.meshgrid(shares, _around(sectors), indexing="ij"))
    pixels = middle + far * radius[:, None] * np.stack([np.cos(phi), np.sin(phi)], -1)
    bearings, valid = known.camera.model.unproject_numpy(pixels)
    shown = valid & shows(known, field, pixels)
    return bearings[shown], radius[shown] / radius[shown].sum()


def shows(known: InformationPrior, field: ImageField | None, pixels: Array) -> NDArray[np.bool_]:
    """Say at which pixels (N, 2) the image shows anything."""
    return known.camera.in_image(pixels) if field is None else field.contains(pixels)


def visible_reach(known: InformationPrior, field: ImageField | None) -> float:
    """Give the largest angle from the axis (radians) that the image shows, as far as the model goes."""
    model = known.camera.model
    angles = angle_from_axis(model.unproject_numpy(_edge(known, field))[0])
    # Where the model ends before the edge it is asked about up to its end.
    inside = np.isfinite(angles)
    last = float(angles[inside].max()) if inside.mean() > 0.5 else model.theta_max
    return min(max(last, known.reach), model.theta_max, LAST)


def _edge(known: InformationPrior, field: ImageField | None) -> Array:
    """Give pixels (N, 2) along the edge of what the image shows."""
    border = known.camera.border()
    if field is None or field.outer is None:
        return border
    outline = field.outer.outline(90)
    return np.concatenate([outline[known.camera.in_image(outline)], border[field.contains(border)]])


def _around(sectors: int) -> Array:
    return 2 * np.pi * np.arange(sectors) / sectors


def effects(known: InformationPrior, bearings: Array) -> tuple[Array, Array, Array]:
    """Give pixels (N, 2), px for each thing known (N, 2, F) and for a turn (N, 2, 3), of directions (N, 3)."""
    pixels, _, d_point, d_params = known.camera.model.project_with_jacobians(bearings)
    return pixels, d_params @ known.camera_basis, -d_point @ so3.hat(bearings)


def _usable(effect: Array, turn_effect: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(effect).all((1, 2)) & np.isfinite(turn_effect).all((1, 2)))


def _turns(known: InformationPrior, last: float) -> tuple[Array, Array]:
    """Give reaches (R,) and the best turn (R, 3, F) over the cone of each: sums over rings, solved for every one."""
    bearings = cap(last, TURN_RINGS)
    _, effect, turn_effect = effects(known, bearings)
    usable = _usable(effect, turn_effect)[:, None, None]
    effect, turn_effect = np.where(usable, effect, 0.0), np.where(usable, turn_effect, 0.0)
    squares = np.einsum("nij,nik->njk", turn_effect, turn_effect)
    products = np.einsum("nij,nik->njk", turn_effect, effect)
    theta = angle_from_axis(bearings)
    reaches = last * np.arange(FEWEST_RINGS, TURN_RINGS + 1) / TURN_RINGS
    ends = np.searchsorted(theta, reaches)  # cap gives ring after ring
    turns = -np.linalg.solve(squares.cumsum(0)[ends - 1], products.cumsum(0)[ends - 1])
    return reaches, turns

"""Sampling of images at pixels with derivatives: bilinear, across the seam of a panorama, averaged by mipmaps."""

import math
from typing import Any, NamedTuple

import torch
import torch.nn.functional as nn_functional
from torch import Tensor

from omnisight.parallel import parallel_for
from omnisight.torch.tensor_functions import constant, has_derivative, is_traced

# Columns beyond the seam, on the coarsest level, that the kernel of the mipmaps and the interpolation reach.
WRAP_COLUMNS = 4
# Pixels around each level in the atlas.
MARGIN_PX = 1
# Coarsest level: a view pixel spans at most 2**6 image pixels.
MAX_LEVEL = 6
# Views with a smaller reduction (log2 of the footprint) need no mipmaps, as in `views.remapper`.
MIN_LEVEL = 0.35
# Pixels of a view that are computed at once without derivatives, which bounds the memory of intermediate results.
BAND_PIXELS = 131072


class Atlas(NamedTuple):
    """An image and its mipmaps in one image, side by side.

    Attributes
    ----------
    image
        (B, channels, height, width).
    corners
        (L, 2) pixel of the atlas of the first pixel (0, 0) of the image on each level.
    limits
        (L, 2, 2) smallest and largest pixel (u, v) of each level.
    """

    image: Tensor
    corners: tuple[Any, ...]
    limits: tuple[Any, ...]

    @property
    def places(self) -> tuple[tuple[float, ...], ...]:
        """The numbers (L, 6) of `corners` and `limits` of each level."""
        return tuple((*corner, *low, *high) for corner, (low, high) in zip(self.corners, self.limits, strict=True))


def sample(
    image: Tensor,
    pixels: Tensor,
    valid: Tensor | None = None,
    *,
    footprint: Tensor | None = None,
    periodic: bool = False,
) -> Tensor:
    """Return the values of an image at pixels, interpolated bilinearly.

    Differentiable by the image and by the pixels. Between the centres of the outer pixels and the border of the image
    the outer pixels continue.

    Parameters
    ----------
    image
        (..., channels, height, width).
    pixels
        (..., *shape, 2) with the same leading dimensions as the image, or with other ones if one of both has none or
        has length 1; `shape` has two dimensions.
    valid
        (..., *shape): where the result is not 0; the finite pixels by default.
    footprint
        (..., rows, columns) number of image pixels that one sample averages across, on a grid over `shape` of the same
        or a lower resolution; None for 1.
    periodic
        Whether the last column is a neighbour of the first.

    Returns
    -------
    (..., channels, *shape) values.
    """
    lead = torch.broadcast_shapes(image.shape[:-3], pixels.shape[:-3])
    shape = (pixels.shape[-3], pixels.shape[-2])
    valid = torch.isfinite(pixels).all(-1) if valid is None else valid
    image = image.expand(*lead, *image.shape[-3:]).reshape(-1, *image.shape[-3:])
    pixels = pixels.to(image.dtype).expand(*lead, *shape, 2).reshape(-1, *shape, 2)
    valid = valid.expand(*lead, *shape).reshape(-1, *shape)
    atlas, level = averaged(image, footprint, shape, periodic=periodic)
    level = None if level is None else level.expand(*lead, *shape).reshape(-1, *shape)
    in_bands = all(x.device.type == "cpu" and not is_traced(x) and not has_derivative(x) for x in (image, pixels))
    values = (_values_in_bands if in_bands else _values)(atlas, pixels, valid, level)
    return values.reshape(*lead, image.shape[1], *shape)


def averaged(
    image: Tensor, footprint: Tensor | None, shape: tuple[int, int], *, periodic: bool
) -> tuple[Atlas, Tensor | None]:
    """Return the mipmaps of images (B, C, H, W) that footprints need, and the level (..., *shape) of each sample.

    There is no level where the images are not averaged.
    """
    count = 0 if footprint is None else _mipmap_count(image, footprint)
    atlas = _atlas(image, count, periodic)
    if footprint is None or count == 0:
        return atlas, None
    coarse = torch.clamp(torch.log2(footprint.to(image.dtype)), 0.0, count)
    level = nn_functional.interpolate(coarse.reshape(-1, 1, *coarse.shape[-2:]), shape, mode="bilinear")
    return atlas, level.view(*footprint.shape[:-2], *shape)


def interpolated(image: Tensor, places: Tensor, level: Tensor | None, u: Tensor, v: Tensor) -> list[Tensor]:
    """Return the channels (B, h, w) of an atlas at pixels, from indexing: a compiler fuses it with what computes them.

    Parameters
    ----------
    image, places
        `Atlas.image` and `Atlas.places`.
    level
        (..., h, w) levels of averaging, as in `averaged`.
    u, v
        (R, h, w) pixels of the images: of each one if R = B, otherwise B or R is 1.
    """
    if level is None:
        return _at_place(image, places[0], u, v)
    level = level.reshape(-1, *level.shape[-2:])
    below = torch.clamp_max(level.floor(), len(places) - 2)
    fine, coarse = (
        _at_place(image, places[k.long()], u * torch.exp2(-k), v * torch.exp2(-k)) for k in (below, below + 1)
    )
    return [a + (level - below) * (b - a) for a, b in zip(fine, coarse, strict=True)]


def _at_place(image: Tensor, place: Tensor, u: Tensor, v: Tensor) -> list[Tensor]:
    """Return the channels of an atlas at pixels (R, h, w) of the levels at places (..., 6)."""
    left, top, u_min, v_min, u_max, v_max = place.unbind(-1)
    x = torch.minimum(torch.maximum(u, u_min), u_max) + left
    y = torch.minimum(torch.maximum(v, v_min), v_max) + top
    x_0, y_0 = x.floor(), y.floor()
    (i, i_next), (j, j_next) = (
        (low.long(), torch.clamp_max(low.long() + 1, size - 1))
        for low, size in zip((x_0, y_0), image.shape[:-3:-1], strict=True)
    )
    batch = torch.arange(len(image), device=image.device)[:, None, None]

    def row(plane: Tensor, j: Tensor) -> Tensor:
        before = plane[batch, j, i]
        return before + (x - x_0) * (plane[batch, j, i_next] - before)

    rows = ((row(plane, j), row(plane, j_next)) for plane in image.unbind(1))
    return [above + (y - y_0) * (below - above) for above, below in rows]


def _values(atlas: Atlas, pixels: Tensor, valid: Tensor, level: Tensor | None) -> Tensor:
    """Return the values of images at pixels (B, h, w, 2), averaged up to a level (B, h, w) between the mipmaps."""
    if torch.is_grad_enabled():  # grid_sample takes NaN, but its derivative is NaN
        pixels = torch.where(valid[..., None], pixels, 0.0)
    if level is None:
        values = _interpolated(atlas, pixels, None)
    else:
        below = torch.clamp_max(level.floor(), len(atlas.limits) - 2)
        fine, coarse = (_interpolated(atlas, pixels, index) for index in (below.long(), below.long() + 1))
        values = fine + (level - below).unsqueeze(1) * (coarse - fine)
    return values.masked_fill_(~valid.unsqueeze(1), 0.0)


def _values_in_bands(atlas: Atlas, pixels: Tensor, valid: Tensor, level: Tensor | None) -> Tensor:
    """Return `_values` without derivatives, on threads: grid_sample computes a single image on one."""
    batch, height, width = valid.shape
    values = atlas.image.new_empty(batch, atlas.image.shape[1], height, width)
    step = max(1, BAND_PIXELS // max(batch * width, 1))

    def compute(first: int, last: int) -> None:
        with torch.no_grad():
            for top in range(first, last, step):
                rows = slice(top, min(top + step, last))
                of_rows = None if level is None else level[:, rows]
                values[:, :, rows] = _values(atlas, pixels[:, rows], valid[:, rows], of_rows)

    parallel_for(compute, height, step)
    return values


def _mipmap_count(image: Tensor, footprint: Tensor) -> int:
    """Return the number of mipmaps of an image that footprints need."""
    count = min(MAX_LEVEL, int(min(image.shape[-2:])).bit_length() - 1)
    if torch.compiler.is_compiling():  # a compiled function must not read the footprint from the device
        return count
    largest = math.log2(float(footprint.max())) if footprint.numel() else 0.0
    return 0 if largest < MIN_LEVEL else min(count, int(largest) + 1)


def _atlas(image: Tensor, count: int, periodic: bool) -> Atlas:
    """Return the mipmaps up to the level `count` of images (B, C, H, W)."""
    padding = WRAP_COLUMNS << count if periodic else 0
    padding = min(padding, image.shape[-1])
    levels = [nn_functional.pad(image, (padding, padding, 0, 0), mode="circular") if padding else image]
    for _ in range(count):
        levels.append(_halved(levels[-1]))
    if count == 0:
        joined = levels[0]
    else:
        # The finest level on the left, the others below one another on its right.
        right = torch.cat(
            [nn_functional.pad(x, (0, levels[1].shape[-1] - x.shape[-1], 0, MARGIN_PX)) for x in levels[1:]], -2
        )
        height = max(levels[0].shape[-2], right.shape[-2])
        parts = [nn_functional.pad(x, (0, 0, 0, height - x.shape[-2])) for x in (levels[0], right)]
        joined = torch.cat(parts, -1)
    corners, limits, row = [], [], 0
    for k, x in enumerate(levels):
        left = padding / 2**k
        corners.append((left + (levels[0].shape[-1] if k else 0), row))
        limits.append(((-left, 0.0), (x.shape[-1] - 1 - left, x.shape[-2] - 1.0)))
        row += x.shape[-2] + MARGIN_PX if k else 0
    return Atlas(joined, tuple(corners), tuple(limits))


def _halved(image: Tensor) -> Tensor:
    """Return every second pixel of images (B, C, H, W) smoothed by (1, 4, 6, 4, 1)/16 along both axes."""
    taps = image.new_tensor((1.0, 4.0, 6.0, 4.0, 1.0)) / 16.0
    batch, channels, height, width = image.shape
    x = image.reshape(batch * channels, 1, height, width)
    mode = "reflect" if min(height, width) > 2 else "replicate"
    x = nn_functional.conv2d(nn_functional.pad(x, (0, 0, 2, 2), mode=mode), taps.view(1, 1, 5, 1), stride=(2, 1))
    x = nn_functional.conv2d(nn_functional.pad(x, (2, 2, 0, 0), mode=mode), taps.view(1, 1, 1, 5), stride=(1, 2))
    return x.reshape(batch, channels, *x.shape[-2:])


def _interpolated(atlas: Atlas, pixels: Tensor, level: Tensor | None) -> Tensor:
    """Return the values at pixels (B, h, w, 2) of the finest level, from levels (B, h, w) or the finest."""
    height, width = atlas.image.shape[-2:]
    scale = constant((2.0 / width, 2.0 / height), pixels)
    if level is None:
        left, top = atlas.corners[0]
        offset = constant((2.0 * (left + 0.5) / width - 1.0, 2.0 * (top + 0.5) / height - 1.0), pixels)
        grid = torch.addcmul(offset, pixels, scale)
    else:
        low, high = constant(atlas.limits, pixels)[level].unbind(-2)
        scaled = pixels * torch.exp2(-level.to(pixels.dtype))[..., None]
        at = torch.minimum(torch.maximum(scaled, low), high) + constant(atlas.corners, pixels)[level]
        grid = (at + 0.5) * scale - 1.0
    return nn_functional.grid_sample(atlas.image, grid, "bilinear", "border", align_corners=False)

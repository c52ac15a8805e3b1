"""Multi-band blending on the whole sphere (Burt and Adelson 1983), with a precomputed part for clips.

The finest bands are blended by narrow weights at full resolution; the coarser ones on an image of an eighth of the
resolution, whose correction is added. The sphere has no border: columns wrap around, and beyond a pole is the opposite
meridian.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

# Reduction of the image on which the coarse bands are blended, and standard deviation of the weights of the fine bands.
REDUCTION, FEATHER_PX = 8, 2.5
# Bands of the reduced image: the coarsest has a period of 8 * 2^5 px, 12 degrees of a sphere of 7680 px.
LEVELS = 5


class Blender:
    """Blends images of a sphere by labels.

    Parameters
    ----------
    labels
        (H, W) index of the image that each pixel is taken from; H and W are multiples of 8.
    seen
        (H, W) which pixels each image has.
    """

    def __init__(self, labels: NDArray[np.intp], seen: Sequence[NDArray[np.bool_]]) -> None:
        import cv2

        height, width = labels.shape
        weights = [_blurred((labels == k).astype(np.float32), FEATHER_PX) * mask for k, mask in enumerate(seen)]
        total = np.maximum(sum(weights), 1e-6)
        self.weights: list[Floats] = [np.asarray(w / total, np.float32) for w in weights]
        self._small = max(1, width // REDUCTION), max(1, height // REDUCTION)
        low_seen = [cv2.resize(mask.astype(np.float32), self._small, interpolation=cv2.INTER_AREA) for mask in seen]
        self._shown = [(share > 0.999)[..., None] for share in low_seen]
        low = [cv2.resize(w, self._small, interpolation=cv2.INTER_AREA)[..., None] for w in self.weights]
        self._masks = [_pyramid(_padded(w[..., 0])) for w in low]
        self._covered = sum(low) > 0.5
        # A reduced pixel at the edge of an image is a mean with what the image does not show.
        whole = [w * shown for w, shown in zip(low, self._shown, strict=True)]
        share = sum(low) / np.maximum(sum(whole), 1e-6)
        self._low = [np.where(sum(whole) > 0, share * w, edge) for w, edge in zip(whole, low, strict=True)]

    def __call__(self, images: Sequence[Bytes]) -> Bytes:
        """Blend images (H, W, 3) of uint8 of the sphere; what an image does not show is ignored."""
        import cv2

        height, width = self.weights[0].shape
        if len(images) == 2:
            sharp = cv2.blendLinear(images[0], images[1], self.weights[0], self.weights[1])
        else:
            total = sum(np.asarray(i, np.float32) * w[..., None] for i, w in zip(images, self.weights, strict=True))
            sharp = np.clip(np.rint(total), 0, 255).astype(np.uint8)
        reduced = [cv2.resize(image, self._small, interpolation=cv2.INTER_AREA).astype(np.float32) for image in images]
        low = self.correction(reduced)
        wrapped = np.concatenate([low[:, -1:], low, low[:, :1]], axis=1)
        padded = cv2.resize(wrapped, (width + 2 * REDUCTION, height), interpolation=cv2.INTER_LINEAR)
        correction = padded[:, REDUCTION:-REDUCTION]
        return np.asarray(cv2.add(sharp, correction, dtype=cv2.CV_8U), np.uint8)

    def correction(self, reduced: Sequence[Floats]) -> Floats:
        """Return what blending the coarse bands changes (h, w, 3), from images (h, w, 3) of the reduced resolution."""
        import cv2

        plain = sum(image * w for image, w in zip(reduced, self._low, strict=True))
        # Where an image shows nothing it continues as the others, so that no band has an edge there.
        filled = [np.where(shown, image, plain) for image, shown in zip(reduced, self._shown, strict=True)]
        bands: list[Any] = []
        for image, masks in zip(filled, self._masks, strict=True):
            gaussian = _pyramid(_padded(image))
            for level, coarse in enumerate(gaussian):
                band = coarse
                if level + 1 < len(gaussian):
                    band = coarse - cv2.pyrUp(gaussian[level + 1], dstsize=coarse.shape[1::-1])
                part = band * masks[level][..., None]
                if level < len(bands):
                    bands[level] = bands[level] + part
                else:
                    bands.append(part)
        weight = [sum(masks[level] for masks in self._masks) for level in range(len(bands))]
        bands = [band / np.maximum(w, 1e-6)[..., None] for band, w in zip(bands, weight, strict=True)]
        blended = bands[-1]
        for band in reversed(bands[:-1]):
            blended = cv2.pyrUp(blended, dstsize=band.shape[1::-1]) + band
        plain = np.asarray(plain)
        pad = _padding(plain.shape)
        return np.asarray((blended[pad:-pad, pad:-pad] - plain) * self._covered, np.float32)


def _padding(shape: tuple[int, ...]) -> int:
    return max(1, min(2**LEVELS, shape[0] // 2))


def _padded(image: NDArray[Any]) -> NDArray[Any]:
    """Extend an image (H, W, ...) of the sphere beyond its borders by what is there on the sphere."""
    pad = _padding(image.shape)
    half = image.shape[1] // 2
    over = np.roll(image, half, axis=1)
    tall = np.concatenate([over[:pad][::-1], image, over[-pad:][::-1]], axis=0)
    return np.concatenate([tall[:, -pad:], tall, tall[:, :pad]], axis=1)


def _pyramid(image: NDArray[Any]) -> list[Any]:
    import cv2

    levels: list[Any] = [np.ascontiguousarray(image, np.float32)]
    while len(levels) < LEVELS and min(levels[-1].shape[:2]) >= 8:
        levels.append(cv2.pyrDown(levels[-1]))
    return levels


def _blurred(weight: Floats, sigma: float) -> Floats:
    import cv2

    pad = _padding(weight.shape)
    return np.asarray(cv2.GaussianBlur(_padded(weight), (0, 0), sigma)[pad:-pad, pad:-pad], np.float32)

"""Views of the images of one camera."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.pipeline.inputs.central_camera import fit_camera
from omnisight.pipeline.views.view_options import ViewOptions
from omnisight.pipeline.views.view_target import view_target
from omnisight.views.cube import cube_cross
from omnisight.views.maps import extrapolation_mask
from omnisight.views.remapper import Remapper

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Period and width of the hatching lines, px along a row.
HATCH_PERIOD_PX, HATCH_LINE_PX = 16, 2


@dataclass(eq=False)
class ViewRenderer:
    """Renders the view of images of one size, the size of the first.

    Attributes
    ----------
    options
        The options with the defaults for the camera.
    source
        The camera of the images, scaled to the first one.
    target
        The camera of the view, or of one face of a cube.
    rotations
        target_from_source (3, 3) of the view, or of each face of a cube.
    """

    source: Camera
    options: ViewOptions
    target: Camera = field(init=False)
    rotations: Sequence[Array] = field(init=False)

    def __post_init__(self) -> None:
        self.options = self.options.for_camera(self.source)
        self.target, self.rotations = view_target(self.options)
        self._remappers: list[Remapper] = []

    def __call__(self, image: NDArray[Any], name: str) -> NDArray[Any]:
        """Return the view of an image.

        Raises
        ------
        ValueError
            If the image has another size than the camera, or than the images before, or shows no part of the view.
        """
        size = image.shape[1], image.shape[0]
        if self.options.scale_camera and self._remappers and size != self.source.size:
            raise ValueError(
                f"{name}: {size[0]}x{size[1]}, others {self.source.width}x{self.source.height}: view it apart"
            )
        self.source = fit_camera(self.source, size, name, scale=self.options.scale_camera)
        self._remappers = self._remappers or [self._remapper(rotation) for rotation in self.rotations]
        if not self.covered.any():
            raise ValueError(
                f"{name}: the camera sees no part of the view, which would be black: change --yaw, --pitch or --fov"
                " (omnisight inspect shows the field of view)"
            )
        view = cube_cross([remap(image) for remap in self._remappers])
        return hatch(view, self.extrapolated & self.covered) if self.options.mark else view

    @cached_property
    def covered(self) -> Mask:
        """Pixels (H, W) of the view that the images cover, after the first one."""
        return cube_cross([remap.mask for remap in self._remappers])

    @cached_property
    def extrapolated(self) -> Mask:
        """Pixels (H, W) of the view outside the calibrated field of view."""
        return cube_cross([extrapolation_mask(self.source, self.target, rotation) for rotation in self.rotations])

    def _remapper(self, rotation: Array) -> Remapper:
        interpolation = self.options.interpolation or "bicubic"
        return Remapper(
            self.source, self.target, rotation, interpolation=interpolation, antialias=self.options.antialias
        )


def hatch(image: NDArray[Any], where: Mask, white: float | None = None) -> NDArray[Any]:
    """Return the image with bright and dark diagonal lines where a mask (H, W) is set, without change of its alpha.

    White is by default the largest value of the type, or 1.
    """
    rows, columns = np.indices(where.shape, np.int32)
    phase = (rows + columns) % HATCH_PERIOD_PX
    hatched = image.copy()
    if white is None:
        white = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
    colors = hatched[..., :3] if image.ndim == 3 else hatched
    colors[where & (phase < HATCH_LINE_PX)] = white
    colors[where & (phase >= HATCH_LINE_PX) & (phase < 2 * HATCH_LINE_PX)] = 0
    return hatched

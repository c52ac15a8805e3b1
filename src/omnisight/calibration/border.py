"""Initial camera from the border of a mirror or an image circle, as in Mei's toolbox."""

import numpy as np
from numpy.typing import ArrayLike

from omnisight.images import ImageField
from omnisight.models.mei import Mei

# Assumed off-axis angle of the border (degrees): mirrors are made to reach somewhat below the horizon, and fisheye
# lenses with a full image circle to cover about 190 degrees.
MIRROR_BORDER_DEG, LENS_BORDER_DEG = 105.0, 95.0
# Share of the normal's squared length across the axis above which the line is taken as radial: it is straight in the
# image as well, and does not determine the focal length.
MAX_RADIAL_SHARE = 0.95


def start_from_border(
    field: ImageField, size: tuple[int, int], *, angle: float | None = None, line: ArrayLike | None = None
) -> Mei:
    """Return an initial camera without any corner.

    The centre of the border is the principal point, xi is 1 (a parabolic mirror, near enough to all mirrors and
    fisheye lenses) and the distortion is 0. The generalized focal length gamma follows from points of one line, if
    given, else from the off-axis angle theta of the border: r = gamma tan(theta/2).

    Parameters
    ----------
    field
        Result of `images.estimate_field`; its outer border is used.
    size
        (width, height) of the images to calibrate, px; the field may be that of scaled copies.
    angle
        Off-axis angle of the border, radians; 105 degrees for a mirror and 95 for a lens if omitted.
    line
        (n, 2) pixels, three or more, of one straight line of the scene that does not pass through the image centre:
        the row of a board, the edge of a wall.

    Returns
    -------
    Mei
        For the `start` of a calibration.

    Raises
    ------
    ValueError
        If no border is visible, the angle is not between 0 and pi, or the line does not determine the focal length.

    Notes
    -----
    Mei and Rives, Single view point omnidirectional camera calibration from planar grids, ICRA 2007: initialization by
    the border of the mirror and the image of a line.
    """
    if field.outer is None:
        raise ValueError("no border of a mirror or lens is visible in these images; calibrate without a start from it")
    border = field.resized(size).outer
    assert border is not None
    theta = np.radians(LENS_BORDER_DEG if field.inner is None else MIRROR_BORDER_DEG) if angle is None else angle
    if not 0 < theta < np.pi:
        raise ValueError(f"the border's angle must be between 0 and pi radians, got {theta}")
    u, v = border.centre
    gamma = border.radius / np.tan(theta / 2) if line is None else focal_from_line(line, border.centre)
    return Mei(fx=float(gamma), fy=float(gamma), cx=u, cy=v, xi=1.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0)


def focal_from_line(pixels: ArrayLike, centre: tuple[float, float]) -> float:
    """Return gamma (px) of the unified model with xi = 1 from pixels (n, 2), n >= 3, of one line of the scene.

    A pixel at (x, y) from the centre has the bearing (x, y, (gamma - r^2/gamma)/2). A line lies in a plane with the
    normal n, so n_x x + n_y y + n_z gamma/2 - r^2 n_z/(2 gamma) = 0. This is linear in c = (n_x, n_y, n_z gamma/2,
    n_z/(2 gamma)), and gamma^2 = c_3/c_4.

    Raises
    ------
    ValueError
        If there are fewer than three pixels, the line passes through the centre, or the pixels lie on no line's image.
    """
    p = np.asarray(pixels, float)
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < 3 or not np.isfinite(p).all():
        raise ValueError(f"a line needs three or more finite pixels (n, 2), got an array of shape {p.shape}")
    plane = p - centre
    unit = np.hypot(*plane.T).max() or 1.0
    x, y = plane.T / unit
    design = np.stack([x, y, np.ones_like(x), -(x * x + y * y)], -1)
    c = np.linalg.svd(design)[2][-1]
    across, along = c[0] ** 2 + c[1] ** 2, 4 * c[2] * c[3]
    if along <= 0 or across > MAX_RADIAL_SHARE * (across + along):
        raise ValueError(
            "the line passes too near the image's centre to determine the focal length; use one further out"
        )
    return float(unit * np.sqrt(c[2] / c[3]))

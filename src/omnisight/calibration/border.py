"""A camera to start from, out of the border of a mirror or of an image circle: the way of Mei's toolbox."""

import numpy as np
from numpy.typing import ArrayLike

from omnisight.images import ImageField
from omnisight.models.mei import Mei

# How far from the axis the border is taken to look. Mirrors are made to look somewhat below the horizon, and lenses
# that show their whole circle reach about as far as they are sold for.
MIRROR_DEG = 105.0
LENS_DEG = 95.0
# A line that passes the centre so closely is straight in the image too, and says nothing of the focal length.
RADIAL = 0.95


def start_from_border(
    field: ImageField, size: tuple[int, int], *, angle: float | None = None, line: ArrayLike | None = None
) -> Mei:
    """Give a camera to start a calibration from, with no corner known.

    The border's centre is the principal point, xi is 1 (a parabola, to which all mirrors and fisheyes are near enough),
    and there is no distortion. The generalised focal length (gamma) comes from points of one line, if they are given,
    else from the angle at which the border looks, r = gamma tan(theta/2).

    Parameters
    ----------
    field
        What `images.estimate_image_field` found; its outer border is used.
    size
        (width, height) of the images to calibrate, px; the field may be that of larger or smaller copies.
    angle
        From the axis to what the border shows, radians; 105 degrees for a mirror and 95 for a lens unless told
        otherwise.
    line
        (n, 2) pixels, three or more, of one straight line of the scene that does not pass the centre: the row of a
        board, the edge of a wall.

    Returns
    -------
    Mei
        For `calibrate_camera(..., start=...)`.

    Raises
    ------
    ValueError
        If no border is seen, or the line does not tell the focal length.

    Notes
    -----
    Mei and Rives, Single view point omnidirectional camera calibration from planar grids, ICRA 2007: the initialisation
    by the mirror's border and a line image.
    """
    if field.outer is None:
        raise ValueError("no border of a mirror or lens is seen in these images; calibrate without a start from it")
    border = field.resized(size).outer
    assert border is not None
    theta = np.radians(LENS_DEG if field.inner is None else MIRROR_DEG) if angle is None else angle
    if not 0 < theta < np.pi:
        raise ValueError(f"the border's angle must be between 0 and pi radians, got {theta}")
    u, v = border.centre
    gamma = border.radius / np.tan(theta / 2) if line is None else focal_from_line(line, border.centre)
    return Mei(fx=float(gamma), fy=float(gamma), cx=u, cy=v, xi=1.0, k1=0.0, k2=0.0, p1=0.0, p2=0.0)


def focal_from_line(pixels: ArrayLike, centre: tuple[float, float]) -> float:
    """Give gamma (px) of the unified model with xi = 1 from pixels (n, 2), n >= 3, of one line of the scene.

    A pixel at (x, y) from the centre has the bearing (x, y, (gamma - r^2/gamma)/2), and a line lies in a plane with the
    normal n, so that n_x x + n_y y + n_z gamma/2 - r^2 n_z/(2 gamma) = 0: linear in c = (n_x, n_y, n_z gamma/2,
    n_z/(2 gamma)), and gamma^2 = c_3/c_4.

    Raises
    ------
    ValueError
        If there are fewer than three pixels, or the line passes the centre, or they lie on no line's image.
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
    if along <= 0 or across > RADIAL * (across + along):
        raise ValueError("the line passes too near the image's centre to tell the focal length; take one further out")
    return float(unit * np.sqrt(c[2] / c[3]))

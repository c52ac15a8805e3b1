"""Branch-free atan2 and sine/cosine, which vectorize in compiled loops; `_elementwise` has the other counterparts."""

from typing import Any

from omnisight.models import _elementwise
from omnisight.models._elementwise import absolute, where


def atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y) for y >= 0, in [0, pi] (radians), to 1 ulp.

    Cephes' rational approximation of atan on [0, tan(pi/8)] after two reductions (Moshier 1989).
    """
    ax = absolute(x)
    steep = y > ax
    numerator, denominator = where(steep, ax, y), where(steep, y, ax)
    past_eighth = numerator > 0.41421356237309503 * denominator
    top = where(past_eighth, numerator - denominator, numerator)
    bottom = where(past_eighth, numerator + denominator, denominator)
    t = top / where(bottom > 0.0, bottom, 1.0)
    z = t * t
    p = -8.750608600031904122785e-1
    p = p * z - 1.615753718733365076637e1
    p = p * z - 7.500855792314704667340e1
    p = p * z - 1.228866684490136173410e2
    p = p * z - 6.485021904942025371773e1
    q = z + 2.485846490142306297962e1
    q = q * z + 1.650270098316988542046e2
    q = q * z + 4.328810604912902668951e2
    q = q * z + 4.853903996359136964868e2
    q = q * z + 1.945506571482613964425e2
    angle = t + t * z * p / q
    angle = where(past_eighth, angle + 0.78539816339744830962, angle)
    angle = where(steep, 1.57079632679489661923 - angle, angle)
    return where(x < 0.0, 3.14159265358979323846 - angle, angle)


def sine_cosine(angle: Any) -> Any:
    """Return (sin, cos) of an angle in [0, pi], to 2 ulp.

    From the sine and cosine of half the distance to pi/2 (Cephes' polynomials on [-pi/4, pi/4]) and double angles.
    """
    x = 0.5 * (angle - 1.57079632679489661923) - 3.06161699786838301793e-17
    z = x * x
    p = 1.58962301576546568060e-10
    p = p * z - 2.50507477628578072866e-8
    p = p * z + 2.75573136213857245213e-6
    p = p * z - 1.98412698295895385996e-4
    p = p * z + 8.33333333332211858878e-3
    p = p * z - 1.66666666666666307295e-1
    sine = x + x * z * p
    q = -1.13585365213876817300e-11
    q = q * z + 2.08757008419747316778e-9
    q = q * z - 2.75573141792967388112e-7
    q = q * z + 2.48015872888517045348e-5
    q = q * z - 1.38888888888730564116e-3
    q = q * z + 4.16666666666665929218e-2
    cosine = 1.0 - 0.5 * z + z * z * q
    return (cosine - sine) * (cosine + sine), -2.0 * sine * cosine


def signed_atan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y), in [-pi, pi] (radians)."""
    angle = _elementwise.atan2(absolute(y), x)
    return where(y < 0.0, -angle, angle)


def signed_sine_cosine(angle: Any) -> Any:
    """Return (sin, cos) of an angle in [-pi, pi]."""
    sine, cosine = _elementwise.sine_cosine(absolute(angle))
    return where(angle < 0.0, -sine, sine), cosine

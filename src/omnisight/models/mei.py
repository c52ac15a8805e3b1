"""The unified model with radial and tangential distortion."""

from dataclasses import dataclass
from typing import Self

from omnisight.models._parameter import parameter
from omnisight.models._planar_distortion import RadialTangentialDistortion
from omnisight.models.unified import XI_PRIOR_SIGMA, UnifiedProfile


@dataclass(frozen=True)
class Mei(RadialTangentialDistortion, UnifiedProfile):
    """Mei and Rives' model: the unified model, then Brown's distortion of its plane.

    (x, y) = (X, Y)/(Z + xi |P|);  (x', y') = radial-tangential (k1, k2, p1, p2);  pixel = K (x', y')

    The same as OpenCV's omnidir and Kalibr's omni-radtan; xi may be negative or above 1. Valid as the unified model,
    and up to the radius where the distortion stops increasing. Mei and Rives, Single view point omnidirectional camera
    calibration from planar grids, ICRA 2007.
    """

    fx: float = parameter("focal length along x (gamma)", unit="px")
    fy: float = parameter("focal length along y (gamma)", unit="px")
    cx: float = parameter("principal point", unit="px")
    cy: float = parameter("principal point", unit="px")
    xi: float = parameter(
        "distance of the second viewpoint from the sphere's centre",
        low=-0.999,
        start_scale=0.4,
        prior_sigma=XI_PRIOR_SIGMA,
    )
    k1: float = parameter("radial distortion")
    k2: float = parameter("radial distortion")
    p1: float = parameter("tangential distortion", start_zero=True)
    p2: float = parameter("tangential distortion", start_zero=True)
    skew: float = parameter("skew of the pixel axes", unit="px", default=0.0, free=False)

    @classmethod
    def example(cls) -> Self:
        return cls(
            fx=478.0,
            fy=476.0,
            cx=512.3,
            cy=383.1,
            xi=1.07,
            k1=-0.11,
            k2=0.03,
            p1=3e-4,
            p2=-2e-4,
            skew=0.4,
        )

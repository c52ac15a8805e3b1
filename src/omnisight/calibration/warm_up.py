"""Having compiled code at hand before it is needed."""

from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.resection import resect
from omnisight.geometry import rotation as so3
from omnisight.models.equidistant import Equidistant
from omnisight.targets import Checkerboard
from omnisight.targets.observations import Observations


def prepare() -> None:
    """Calibrate next to nothing: what is compiled is made the first time on a machine, and loaded from then on.

    Takes seconds the first time, and tenths of one otherwise: for a thread of its own while images are looked at.
    """
    model = Equidistant.example()
    board = Checkerboard(4, 3).points
    poses = so3.exp([(0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (-0.3, 0.0, 0.2)])
    views = Observations.of([(board, model.project_numpy(board @ pose.T + (-1.5, -1.0, 4.0))[0]) for pose in poses])
    refine(resect(model, views), views, iterations=1)

"""Compiled relative pose of a car: hypotheses of one pair, refined without the constraint of the car."""

# Compiled code takes its types from its arguments.
# pyright: basic

from typing import Any, NamedTuple

from omnisight.twoview._relative_pose_kernel import RelativePoseProblem
from omnisight.twoview._upright_kernel import circular_one_point
from omnisight.twoview.bearing_pairs import BearingPairs


class CircularMotionProblem(NamedTuple):
    """Pairs of bearings in the axes of a vehicle, y down and z ahead; see `RelativePoseProblem`.

    Samples are one pair, whose motion is an arc of a circle; steps of the model are those of any relative pose.
    """

    a: Any
    b: Any
    covariance_a: Any
    covariance_b: Any
    variance_a: Any
    variance_b: Any

    @classmethod
    def of(cls, pairs: BearingPairs) -> "CircularMotionProblem":
        return cls(*pairs.arrays)

    @staticmethod
    def sizes(problem):
        return 1, 1, 1, 5

    @staticmethod
    def solve_minimal(problem, sample, models):
        return circular_one_point(problem.a[sample], problem.b[sample], models)

    squared_error = staticmethod(RelativePoseProblem.squared_error)
    linearize = staticmethod(RelativePoseProblem.linearize)
    feature = staticmethod(RelativePoseProblem.feature)
    outlier_density = staticmethod(RelativePoseProblem.outlier_density)
    retract = staticmethod(RelativePoseProblem.retract)

"""Where the rays of an axial camera start: the place on its axis, over the angle."""

import numpy as np

from omnisight.optics.models.axial import Axial
from omnisight.quality.noncentral_test import SURE
from omnisight.quality.pupil_shift import PupilShift
from omnisight.quality.uncertainty import LAST
from omnisight.report.axes import Axes, chart
from omnisight.report.html import element, together
from omnisight.report.report_data import LEAST, Figure, Material
from omnisight.report.sections.radial_profile import hatched

ANGLES = 121
# The frame is so many times as high as what lies in it where corners were seen.
ROOM = 1.3


def travel(m: Material) -> Figure | None:
    """Draw the place with its band; nothing of a camera whose rays do not pass its axis by its model."""
    model, covariance, moved = m.camera.model, m.camera.covariance, m.travel
    if moved is None or not isinstance(model, Axial) or covariance is None:
        return None
    first, reach = float(np.degrees(m.camera.theta_min)), float(np.degrees(m.reach))
    shown_to = float(m.calibration.trust.coverage.edges[-1])
    theta = np.linspace(0, min(max(m.reach, shown_to), model.theta_max, LAST), ANGLES)
    whole = PupilShift.of(model, covariance, theta, m.camera.theta_min)
    scale = m.drawn_length[0]
    degrees, place, sigma = np.degrees(theta), scale * whole.place, scale * whole.sigma
    low, high = (scale * (moved.place - moved.sigma)).min(), (scale * (moved.place + moved.sigma)).max()
    middle, half = (high + low) / 2, max(ROOM * (high - low) / 2, LEAST)
    axes = Axes(
        (0.0, float(degrees[-1])),
        (float(middle - half), float(middle + half)),
        "angle from the axis θ, degrees",
        f"place on the axis, {m.drawn_length[1]}",
    )
    length, times = m.length(moved.length, moved.length_sigma), moved.length / max(moved.length_sigma, LEAST)
    boards = np.linalg.norm(m.calibration.state.points(m.calibration.views)[0][m.usable], axis=1)
    nearest, farthest = (m.length(float(np.quantile(boards, share))) for share in (0.01, 0.99))
    sentence = f"From {first:.0f}° to {reach:.0f}° from the axis the viewpoint moves by {length}."
    return Figure(
        "travel",
        "Where the rays start",
        together(
            element("p", sentence, class_="lead"),
            chart(
                axes.frame(),
                axes.inside(
                    *hatched(axes, first, reach),
                    axes.band(degrees, place - sigma, place + sigma, "band"),
                    axes.line(axes.x, (0.0, 0.0), "zero"),
                    axes.line(degrees, place, "curve"),
                ),
                said=f"The place on the axis from where rays start, over the angle. {sentence}",
            ),
            element("p", f"Corners were {nearest} to {farthest} away.", class_="note"),
        ),
        (
            "All rays of this camera pass its axis, but not all in one point. Drawn is where they do, + is forwards,"
            " beside the first that a corner was seen along; the band is one standard deviation to each side. Hatched"
            " is where no corner was seen: there the curve is only the model's guess. Its lens, that says where rays"
            " go, is drawn above.",
            f"A travel of many times its standard deviation ({SURE:.0f} are beyond doubt, here it has {times:.0f}), and"
            " a narrow band. What is nearer than the boards were relies on this curve the most, what is far not at"
            " all.",
            "If the band is wide, hold boards very near and far, out to the rim: only the two together tell a viewpoint"
            " that moves from a lens. If the curve is flat within its band, a central camera does as well.",
        ),
        "PupilShift",
    )

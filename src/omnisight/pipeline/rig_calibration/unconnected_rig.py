"""Why common boards do not connect the cameras of a rig, and what to do."""

from omnisight.calibration.rigs.estimation import Unconnected
from omnisight.calibration.rigs.initial_rig import is_reliable


def explain_unconnected(error: Unconnected, rule: str) -> str:
    """Return why common boards do not connect the cameras, with the pairs and what to do.

    Parameters
    ----------
    error
        The error.
    rule
        What simultaneous images have in common, see `SimultaneousViews`.
    """
    names = error.observations.names
    counts = [
        f"{names[a]}-{names[b]} {len(error.observations.common_frames(a, b))}"
        + (
            ""
            if (pair := error.pairs.get((a, b))) is None or is_reliable(pair)
            else f" ({pair.support} agree on a relative pose)"
        )
        for a in range(len(names))
        for b in range(a + 1, len(names))
    ]
    if error.mirrored:
        mirrored = " or ".join(names[camera] for camera in error.mirrored)
        return (
            f"the images of {mirrored} are mirror images: the poses of the boards in simultaneous images fit those of"
            " the other cameras only if they are flipped. Turn off the mirror mode of the camera, or flip its images"
            " left to right"
        )
    contradicting = [pair for pair in error.pairs.values() if not is_reliable(pair)]
    advice = (
        "the images are not simultaneous, or the cameras moved: check that images with the same"
        f" {'place in the order' if rule == 'order' else rule} were taken at the same time"
        + ("" if rule == "time" else ", or specify their times with --times")
        if contradicting
        else "take about 10 images with the board where two of the cameras that are not connected both see it"
    )
    parts = " | ".join(", ".join(part) for part in error.components)
    return (
        f"the cameras are not connected ({parts}): simultaneous images of a board by pair of cameras, matched by"
        f" {rule}: {', '.join(counts)}; {advice}"
    )

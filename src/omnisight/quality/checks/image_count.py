"""Check for enough images with different board poses."""

from omnisight.calibration.model_selection import MIN_VIEWS
from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.identifiability import unidentifiable_parameters
from omnisight.quality.repeated_views import (
    MIN_DISPLACEMENT,
    MIN_TILT_DEG,
    count_independent_views,
    find_repeated_views,
    list_pairs,
)

PRIORITY = 0

# Half of the cameras calibrated from three to five images were off by more than 0.3 px, the worst by 0.65 px.
MIN_GOOD_VIEWS = 6
# Share of repeated views up to which the covariance, which counts them as new, is hardly too small.
MAX_REPEATED_SHARE = 0.2


def check(evidence: Evidence) -> Check:
    """Check for enough images with different board poses."""
    count = len(evidence.observations)
    repeated = find_repeated_views(evidence.observations)
    distinct = count_independent_views(evidence.candidate.state, evidence.observations)
    sentences: list[str] = []
    level = Level.USABLE if len(repeated) > MAX_REPEATED_SHARE * count else Level.GOOD
    if repeated:
        verbs = ("image repeats", "adds") if len(repeated) == 1 else ("images repeat", "add")
        sentences.append(
            f"{len(repeated)} {verbs[0]} another one ({list_pairs(repeated)}) and {verbs[1]} no information: move the"
            " board between images."
        )
    if distinct < min(MIN_GOOD_VIEWS, count - len(repeated)):
        sentences.append(
            f"The {count} images show nearly the same board {'pose' if distinct == 1 else 'poses'}: they differ by less"
            f" than {MIN_TILT_DEG:.0f}° of tilt and {MIN_DISPLACEMENT:.0%} of the image."
        )
    if distinct < MIN_VIEWS:
        level = Level.DO_NOT_USE
        unknown = unidentifiable_parameters(evidence.camera)
        names = f" ({', '.join(unknown)})" if unknown else ""
        sentences.append(
            f"{distinct} distinct {'image does' if distinct == 1 else 'images do'} not determine all parameters{names},"
            " although residuals are small: take 10 to 20 images with the board tilted and everywhere in the image."
        )
    elif distinct < MIN_GOOD_VIEWS:
        level = Level.USABLE
        sentences.append(f"Only {distinct} distinct images: take 10 to 20.")
    return Check("image count", level, " ".join(sentences))

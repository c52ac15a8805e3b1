"""Check that all images are of one camera in one state."""

from omnisight.quality.evidence import Check, Evidence, Level
from omnisight.quality.wording import list_first

PRIORITY = 5

# Share of outliers in an image above which it does not belong to the set.
MAX_IMAGE_SHARE = 0.5
# Share of outliers in all images of a good and of a usable camera: with 12 % outliers and two boards assigned wrongly,
# a camera was off by 0.54 px, 1.6 times as much as stated.
MAX_SHARE = (0.15, 0.3)
# Share of images that do not belong above which it is open which ones do.
MAX_SHARE_OF_IMAGES = 1 / 3


def check(evidence: Evidence) -> Check:
    """Check the share of outliers in every image and in total."""
    views = zip(evidence.observations.names, evidence.observations.groups, strict=True)
    names = [name for name, rows in views if evidence.outliers[rows].mean() > MAX_IMAGE_SHARE]
    share = float(evidence.outliers.mean())
    level = Level.USABLE if names or share > MAX_SHARE[0] else Level.GOOD
    if len(names) >= MAX_SHARE_OF_IMAGES * len(evidence.observations) or share > MAX_SHARE[1]:
        level = Level.DO_NOT_USE
    if not level:
        return Check("outliers")
    subject = f"Most corners of {list_first(names)} are" if names else f"{share:.0%} of the corners are"
    return Check(
        "outliers",
        level,
        f"{subject} outliers of the common camera: another camera or focus, or blur. Leave those images out (--drop)"
        " and calibrate again.",
    )

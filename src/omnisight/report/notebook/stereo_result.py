"""HTML of distances from a stereo pair: the distances in colours over the left image."""

from omnisight.pipeline.two_views.stereo import StereoResult
from omnisight.report.drawings.stereo import draw_distances
from omnisight.report.notebook._summary import photo_url, summary


def html(result: StereoResult) -> str:
    """Return how well the images agree, the distances and their drawing, or why there are none."""
    check = result.check
    figures = {
        "matches": f"{check.inliers} of {check.matches} agree with a relative pose",
        "row difference": f"{check.row_px:.2f} px (median)" if check.inliers else "unknown",
    }
    if not result:
        return summary("StereoResult", figures | {"no distances": result.reason}, None)
    low, median, high = result.quantiles
    figures |= {"distances": f"{low:.3g} to {high:.3g}, median {median:.3g} {result.unit}"}
    return summary("StereoResult", figures, photo_url(draw_distances(result)), list(result.warnings))

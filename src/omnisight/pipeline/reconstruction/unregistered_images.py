"""The images that are in no model of a reconstruction, with the reasons."""

from collections.abc import Sequence

from omnisight.pipeline.inputs.image_set import ImageSet
from omnisight.pipeline.inputs.photo import MIN_KEYPOINTS
from omnisight.pipeline.reconstruction.detected_images import DetectedImages
from omnisight.sfm.reconstruction import Reconstruction
from omnisight.sfm.view_graph import MIN_INLIERS, ViewGraph


def unregistered_images(
    files: ImageSet, models: Sequence[Reconstruction], detected: DetectedImages, graph: ViewGraph
) -> dict[str, str]:
    """Return the names of the images that are in no model, with the reason."""
    registered = {name for model in models for name in model.names}
    matched = {image for edge in graph.edges for image in edge.images}
    readable = len(files) - len(detected.unreadable)
    return {
        name: detected.unreadable.get(i) or _reason(len(detected.keypoints[i]), readable, has_edges=i in matched)
        for i, name in enumerate(files.names)
        if name not in registered
    }


def _reason(keypoints: int, images: int, *, has_edges: bool) -> str:
    """Return why an image is in no model, from the numbers of its keypoints and of the images that can be read."""
    if images < 2:
        return "one image shows no motion: specify a folder of two or more"
    if keypoints < MIN_KEYPOINTS:
        return f"{keypoints} keypoints: the image shows no texture in the field of view of its camera"
    if not has_edges:
        return f"no overlap: no other image has {MIN_INLIERS} matches that agree with a motion"
    return "its matches do not agree with the poses of the other images"

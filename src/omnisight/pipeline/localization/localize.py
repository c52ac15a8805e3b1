"""Localization of images in a map: `omnisight localize`."""

from collections.abc import Iterable
from os import PathLike

from omnisight.features import FeatureOptions, detect_features
from omnisight.images import read_image, read_mask, reason_without_name
from omnisight.localization.focal_length_check import check_focal_length
from omnisight.localization.localize import LocalizedImage
from omnisight.localization.localize import localize as localize_keypoints
from omnisight.localization.visual_map import VisualMap
from omnisight.pipeline.inputs.central_camera import CameraSource, camera_of_image, central_camera
from omnisight.pipeline.inputs.image_set import image_set
from omnisight.pipeline.localization.localization_result import LocalizationResult
from omnisight.pipeline.localization.localize_options import LocalizeOptions
from omnisight.pipeline.localization.visual_map import read_map
from omnisight.progress import Progress, no_progress


def localize(
    images: str | PathLike[str] | Iterable[str | PathLike[str]],
    visual_map: VisualMap | str | PathLike[str],
    camera: CameraSource | None = None,
    options: LocalizeOptions = LocalizeOptions(),
    progress: Progress = no_progress,
) -> LocalizationResult:
    """Estimate the poses of images in a map that other images, of any other camera, were used for.

    Parameters
    ----------
    images
        Folder, or image files.
    visual_map
        The map, or its folder.
    camera
        The camera of the images, or its calibration file; none is needed for 2:1 equirectangular images.
    options
        Options of the command.
    progress
        Called with the stage, the work done and the total.

    Returns
    -------
    For each image, by name, its pose and covariance, or the reason why it is unknown; and the focal length that the
    images agree with best, if it differs from that of the camera and moves the poses.

    Raises
    ------
    ValueError
        If the map or the camera cannot be read, or no image can be read and has the size of the camera.
    """
    known = visual_map if isinstance(visual_map, VisualMap) else read_map(visual_map)
    source = None if camera is None else central_camera(camera, name=options.name, accepts_distance=False)
    files = image_set(images)
    found: dict[str, LocalizedImage] = {}
    unusable = list[ValueError]()
    for path, name in zip(files.paths, files.names, strict=True):
        progress("localize", len(found), len(files))
        try:
            image = read_image(path, apply_exif=options.apply_exif)
            size = image.shape[1], image.shape[0]
            model = camera_of_image(source, size, str(path), name=None, scale=options.scale_camera)
        except ValueError as error:
            unusable.append(error)
            found[name] = LocalizedImage.without_pose(reason_without_name(error, path), is_usable=False)
            continue
        mask = None if options.mask is None else read_mask(options.mask, size)
        keypoints = detect_features(image, model, FeatureOptions(max_keypoints=options.max_keypoints), mask=mask)
        found[name] = localize_keypoints(keypoints, known, model)
    progress("localize", len(found), len(files))
    if len(unusable) == len(files):
        raise unusable[0]
    checked, change = check_focal_length(list(found.values()))
    return LocalizationResult(dict(zip(found, checked, strict=True)), change)

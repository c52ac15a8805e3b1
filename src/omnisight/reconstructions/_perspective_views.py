"""A reconstruction in perspective views of its images: the views of a camera are cameras of a rig."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.geometry.pose import Pose
from omnisight.geometry.rotation import look
from omnisight.geometry.sphere import angle_from_axis
from omnisight.images import ImageField
from omnisight.models.pinhole import Pinhole
from omnisight.rig import Rig
from omnisight.sfm.reconstruction import PointObservations, Reconstruction
from omnisight.views import Remapper, perspective
from omnisight.views.cube import CUBE_FACES
from omnisight.views.maps import extrapolation_mask, resolution, view_map

# Up to this angle from the axis one perspective view stretches its sides by less than two.
MAX_SINGLE_VIEW_RAD = np.radians(45.0)
# A view that the camera covers less is left out.
MIN_COVERED_FRACTION = 0.05


@dataclass(frozen=True)
class PerspectiveView:
    """A perspective view of the images of a camera.

    Attributes
    ----------
    name
        "front", "right" ...
    remapper
        Makes the view of an image.
    mask
        (H, W) bool: pixels that show the scene.
    """

    name: str
    remapper: Remapper
    mask: NDArray[np.bool_]

    @property
    def pose(self) -> Pose:
        """The pose view_from_camera."""
        return Pose(self.remapper.target_from_source)


def perspective_views(camera: Camera, field: ImageField | None, size: int | None) -> list[PerspectiveView]:
    """Return one view of a narrow camera, and of others the faces of a cube that it covers.

    Parameters
    ----------
    camera
        The camera.
    field
        The region of its images that is not dark, or None if all of it is used.
    size
        The width of a view of 90 degrees, px; by default the resolution of the image is kept.

    Raises
    ------
    ValueError
        If no view shows enough of the image.
    """
    bearings, _ = camera.samples()
    if not len(bearings):
        raise ValueError("no pixel of the image is in the calibrated field of view")
    side = size or max(1, round(2 * float(np.median(resolution(camera, bearings)))))
    if angle_from_axis(bearings).max() <= MAX_SINGLE_VIEW_RAD:
        plane = np.abs(Pinhole(side / 2, side / 2, 0.0, 0.0).project(bearings)[0]).max(axis=0)
        width, height = (max(1, round(2 * float(half))) for half in plane)
        model = Pinhole(side / 2, side / 2, (width - 1) / 2, (height - 1) / 2)
        targets = {"front": (Camera(model, (width, height)), np.eye(3))}
    else:
        face = perspective(side, 90.0)
        targets = {name: (face, look(yaw, pitch)) for name, (yaw, pitch) in CUBE_FACES.items()}
    views = [_view(name, camera, target, rotation, field) for name, (target, rotation) in targets.items()]
    views = [view for view in views if view.mask.mean() >= MIN_COVERED_FRACTION]
    if not views:
        raise ValueError(f"no view shows {MIN_COVERED_FRACTION:.0%} of the image")
    return views


def _view(
    name: str, camera: Camera, target: Camera, rotation: NDArray[np.float64], field: ImageField | None
) -> PerspectiveView:
    """Return a view with its mask."""
    remapper = Remapper(camera, target, rotation)
    mask = remapper.mask & ~extrapolation_mask(camera, target, rotation)
    if field is not None:
        mask &= field.contains(np.stack(view_map(camera, target, rotation), -1))
    return PerspectiveView(name, remapper, mask)


def in_perspective_views(
    reconstruction: Reconstruction, views: Sequence[Sequence[PerspectiveView]], names: Sequence[Sequence[str]]
) -> Reconstruction:
    """Return a reconstruction whose images are the views of the images of another one.

    Parameters
    ----------
    reconstruction
        The reconstruction.
    views
        The views of each camera.
    names
        For each image the names of its views.

    Returns
    -------
    reconstruction
        The same points and frames; an observation is in the view that shows it, if there is one.
    """
    rig = reconstruction.rig
    sensors = {
        f"{rig.names[s]}_{view.name}": (view.remapper.target, view.pose @ rig.sensor_from_rig[s])
        for s, own in enumerate(views)
        for view in own
    }
    first_sensor = np.cumsum([0, *(len(own) for own in views)])
    counts = np.array([len(own) for own in names], np.intp)
    first_image = np.cumsum(counts) - counts
    place = np.arange(counts.sum()) - np.repeat(first_image, counts)
    return dataclasses.replace(
        reconstruction,
        rig=Rig.from_sensors(sensors),
        names=tuple(name for own in names for name in own),
        sensor=np.repeat(first_sensor[reconstruction.sensor], counts) + place,
        frame=np.repeat(reconstruction.frame, counts),
        observations=_observations_in_views(reconstruction, views, first_image),
    )


def _observations_in_views(
    reconstruction: Reconstruction, views: Sequence[Sequence[PerspectiveView]], first_image: NDArray[np.intp]
) -> PointObservations:
    """Return each observation in the first view that shows it; those outside all views are left out."""
    old = reconstruction.observations
    image, pixels, residuals = np.full(len(old), -1), np.full((len(old), 2), np.nan), np.full((len(old), 2), np.nan)
    sensor = reconstruction.sensor[old.image]
    for s, (camera, own) in enumerate(zip(reconstruction.rig.cameras, views, strict=True)):
        of_sensor = sensor == s
        observed, predicted = (camera.rays(at[of_sensor]).bearings for at in (old.pixels, old.pixels + old.residuals))
        rows = np.flatnonzero(of_sensor)
        for k, view in enumerate(own):
            (at, valid), (model_at, model_valid) = (
                view.remapper.target.project(view.pose @ bearings) for bearings in (observed, predicted)
            )
            shown = valid & model_valid & view.remapper.target.in_image(at) & (image[rows] < 0)
            chosen = rows[shown]
            image[chosen] = first_image[old.image[chosen]] + k
            pixels[chosen], residuals[chosen] = at[shown], model_at[shown] - at[shown]
    kept = image >= 0
    return PointObservations(image[kept].astype(np.intp), old.point[kept], pixels[kept], residuals[kept])

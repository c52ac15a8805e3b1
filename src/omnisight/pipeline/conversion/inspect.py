"""Description of calibration files: the counterpart of `omnisight inspect`."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.extensions import did_you_mean
from omnisight.formats import FormatError, format_names, get_format, load_all
from omnisight.models._profile_camera import ProfileCamera
from omnisight.optics.central_limit import CentralLimit
from omnisight.optics.models.axial import Axial
from omnisight.ray_camera import RayCamera

Array = NDArray[np.float64]

PROFILE_ANGLES, PROFILE_AZIMUTHS = 400, 24  # samples of r(theta); a multiple of 4 azimuths
MAX_PROFILE_THETA_RAD = 0.999 * np.pi  # opposite to the axis the azimuth is undefined


@dataclass(frozen=True)
class RadialProfile(Displayed):
    """Distance from the principal point (px) against the angle from the axis (degrees).

    It is averaged over all azimuths, and for panoramas and other projections without rotational symmetry over both
    directions along the longer side of the image.

    Attributes
    ----------
    theta_deg, radius
        (N,) and (N,), inside the image.
    focal
        px per radian on the axis.
    centre
        Pixel of the axis.
    calibrated_deg
        The least and the largest calibrated angle from the axis, or None if they are unknown.
    """

    theta_deg: Array
    radius: Array
    focal: float
    centre: tuple[float, float]
    calibrated_deg: tuple[float, float] | None

    def is_calibrated(self, theta_deg: Array) -> NDArray[np.bool_]:
        """Return which angles from the axis (degrees) are calibrated; all if that is unknown."""
        least, largest = (0.0, np.inf) if self.calibrated_deg is None else self.calibrated_deg
        return (theta_deg >= least) & (theta_deg <= largest)


@dataclass(frozen=True)
class ParameterValue(Displayed):
    """A parameter of a camera model.

    Attributes
    ----------
    name, unit, description
        As the model defines them.
    value
        Its value.
    sigma
        Its standard deviation, 0 if it was fixed, None if unknown.
    """

    name: str
    unit: str
    description: str
    value: float
    sigma: float | None


@dataclass(frozen=True)
class CameraDescription(Displayed):
    """What a calibration file holds about one camera.

    Attributes
    ----------
    camera
        The camera.
    format_title, convention
        The name and the convention of the file's format.
    model_title
        The first line of the model's documentation.
    parameters
        All parameters of the model.
    profile
        r(theta) of the camera, or of its lens if the entrance pupil shifts along the axis; None for other non-central
        cameras.
    field_deg
        The angles between opposite edges, horizontal and vertical, and opposite corners of the image through the
        principal point; None where the model ends before. None if there is no profile or the image size is unknown.
    pupil_shift
        The shift of the entrance pupil along the axis over the calibrated field of view, in `camera.unit`, or None.
    """

    camera: Camera | RayCamera
    format_title: str
    convention: str
    model_title: str
    parameters: tuple[ParameterValue, ...]
    profile: RadialProfile | None
    field_deg: tuple[float | None, float | None, float | None] | None
    pupil_shift: float | None


def inspect(path: str | Path, *, name: str | None = None) -> dict[str, CameraDescription]:
    """Describe the cameras of a calibration file by name.

    Parameters
    ----------
    path
        A calibration file of any format.
    name
        Describe this camera only.

    Raises
    ------
    FormatError
        If the file cannot be read or does not hold the camera.
    """
    cameras = load_all(path)
    if name is not None:
        if name not in cameras:
            raise FormatError(f"{path}: no camera {name!r}{did_you_mean(name, cameras)}; it holds {', '.join(cameras)}")
        cameras = {name: cameras[name]}
    return {key: describe_camera(camera) for key, camera in cameras.items()}


def describe_camera(camera: Camera | RayCamera) -> CameraDescription:
    """Describe a camera."""
    source = camera.provenance.get("format")
    source_format = get_format(source if source in format_names() else "native")
    central = _central_part(camera)
    profile = None if central is None else radial_profile(central)
    return CameraDescription(
        camera=camera,
        format_title=source_format.TITLE,
        convention=source_format.CONVENTION,
        model_title=(type(camera.model).__doc__ or "").strip().splitlines()[0],
        parameters=_parameters(camera),
        profile=profile,
        field_deg=None if central is None or profile is None else _fields_of_view(central),
        pupil_shift=_pupil_shift(camera),
    )


def extrapolated_beyond_deg(camera: Camera | RayCamera, fields_deg: Iterable[float | None]) -> float | None:
    """Return the calibrated field of view, degrees, if one of those of the image is larger; otherwise None."""
    limit = float(np.degrees(2 * (camera.theta_max or np.inf)))
    return limit if any(field is not None and field > limit for field in fields_deg) else None


def radial_profile(camera: Camera) -> RadialProfile:
    """Sample r(theta) from the axis to the edge of the image."""
    limit = min(camera.model.theta_max, MAX_PROFILE_THETA_RAD)
    theta = np.linspace(0, limit, PROFILE_ANGLES)[1:-1]
    azimuth = np.linspace(0, 2 * np.pi, PROFILE_AZIMUTHS, endpoint=False)
    if not isinstance(camera.model, ProfileCamera | CentralLimit):
        azimuth = azimuth[[0, PROFILE_AZIMUTHS // 2]] + (0 if camera.width >= camera.height else np.pi / 2)
    s, c = np.sin(theta)[:, None], np.cos(theta)[:, None]
    bearings = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), c + 0 * azimuth], -1)
    # Plain NumPy, because numba takes half a second to load.
    (centre, *rows), valid = camera.model.project_numpy(np.vstack([[0.0, 0.0, 1.0], bearings.reshape(-1, 3)]))
    pixels, valid = np.reshape(rows, (*bearings.shape[:2], 2)), valid[1:].reshape(bearings.shape[:2])
    inside = valid & (camera.in_image(pixels) if camera.width else True)
    distance = np.where(inside, np.linalg.norm(pixels - centre, axis=-1), np.nan)
    in_any_azimuth = np.isfinite(distance).any(1)
    count = int(np.argmin(np.append(in_any_azimuth, False)))
    radius = np.nanmean(distance[:count], axis=1) if count else np.zeros(0)
    cone = None if camera.theta_max is None else (camera.theta_min, camera.theta_max)
    calibrated = None if cone is None else (float(np.degrees(cone[0])), float(np.degrees(cone[1])))
    return RadialProfile(
        np.degrees(theta[:count]), radius, camera.focal, (float(centre[0]), float(centre[1])), calibrated
    )


def model_title(camera: Camera) -> str:
    """Return the name of the model of a camera, for a heading."""
    model = camera.model
    return f"{model.rays.name}, distant scene" if isinstance(model, CentralLimit) else model.name


def _central_part(camera: Camera | RayCamera) -> Camera | None:
    """Return a central camera, or the lens of a camera whose entrance pupil shifts along the axis."""
    if isinstance(camera, Camera):
        return camera
    if not isinstance(camera.model, Axial):
        return None
    return Camera(camera.model.lens, camera.size, theta_max=camera.theta_max, theta_min=camera.theta_min)


def _parameters(camera: Camera | RayCamera) -> tuple[ParameterValue, ...]:
    """Return the parameters of a camera with their standard deviations."""
    variances = None if camera.covariance is None else np.diagonal(camera.covariance)
    length_unit = camera.unit if isinstance(camera, RayCamera) else "m"
    return tuple(
        ParameterValue(
            name=parameter.name,
            unit=length_unit if parameter.unit == "m" else parameter.unit,
            description=parameter.doc,
            value=float(value),
            sigma=None if variances is None else float(np.sqrt(max(variances[i], 0.0))),
        )
        for i, (parameter, value) in enumerate(zip(camera.model.parameters, camera.model.params, strict=True))
    )


def _fields_of_view(camera: Camera) -> tuple[float | None, float | None, float | None] | None:
    """Return the horizontal, vertical and diagonal field of view (degrees), None where the model ends."""
    if not camera.width:
        return None
    horizontal, vertical, diagonal = (angle if np.isfinite(angle) else None for angle in camera.fov)
    return horizontal, vertical, diagonal


def _pupil_shift(camera: Camera | RayCamera) -> float | None:
    """Return the entrance pupil shift over the calibrated field of view, or None."""
    if not isinstance(camera, RayCamera) or not isinstance(camera.model, Axial):
        return None
    return float(camera.model.pupil_shift(camera.theta_min, camera.theta_max or camera.model.theta_max))

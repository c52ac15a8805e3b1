"""Convert a camera to another model."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.display import Displayed
from omnisight.file_fields import reflected_fields
from omnisight.models import model_class

Array = NDArray[np.float64]

AGREEMENT_PX = 0.5  # less than the accuracy that most users need
GRID, DENSE_GRID = 41, 161  # samples along each side of the image
MIN_DENSE_SAMPLES = 100  # with fewer, the dense grid is used
MIN_SAMPLES = 20  # with fewer, no model is fitted
MIN_THETA_MAX_RAD = float(np.radians(5.0))  # the narrowest field of view for a fit
BISECTIONS = 8  # of the field of view, to a third of a degree
MAX_FLIP_PX = 1e-6  # models with parameters for a reflection are exact up to rounding


@dataclass(frozen=True)
class Conversion(Displayed):
    """A camera fitted to another one.

    Attributes
    ----------
    camera
        The fitted camera.
    theta_max
        The angle from the axis (radians) up to which the model was fitted: the calibrated field of view, or the whole
        image.
    max_px, rms_px, mean_px
        Distance of the pixels of equal bearings; inf where the fitted camera has none.
    max_deg, rms_deg
        Angle between the bearings of equal pixels, degrees.
    worst_theta
        The angle from the axis (radians) of `max_px`, or the smallest angle without pixels.
    agreement_theta
        The angle from the axis (radians) up to which the pixels agree within half a pixel.
    """

    camera: Camera
    theta_max: float
    max_px: float
    rms_px: float
    mean_px: float
    max_deg: float
    rms_deg: float
    worst_theta: float
    agreement_theta: float


def convert_model(camera: Camera, model: str, *, theta_max: float | None = None) -> Conversion:
    """Fit another camera model to a camera over its calibrated field of view.

    Parameters
    ----------
    camera
        The camera to convert.
    model
        The model to fit.
    theta_max
        Fit up to this angle from the axis (radians) instead.

    Raises
    ------
    ValueError
        If the model is unknown or cannot be fitted.
    """
    cls = model_class(model)
    bearings, pixels = _samples(camera, theta_max)
    if cls is type(camera.model):
        return _compare(camera, bearings, pixels)
    try:
        fitted = cls.fit(bearings, pixels)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"{model} cannot be fitted to this {camera.model.name} camera: {error}") from error
    converted = dataclasses.replace(
        camera,
        model=fitted,
        theta_max=camera.theta_max if theta_max is None else theta_max,
        covariance=None,
    )
    result = _compare(converted, bearings, pixels)
    provenance = {
        **camera.provenance,
        "converted_from": camera.model.name,
        "conversion_max_px": result.max_px if np.isfinite(result.max_px) else None,
    }
    return dataclasses.replace(result, camera=dataclasses.replace(converted, provenance=provenance))


def flip_frame(camera: Camera) -> Camera:
    """Return the camera in the reflected frame, whose x axis has the opposite direction.

    Images of boards without markers do not determine whether the camera looks into a mirror, which exchanges left and
    right. `calibrate` assumes that it does not; the frame of a camera with one mirror is then left-handed, and
    `flip_frame` returns it in a right-handed one, as two views and rigs of different cameras need it. Poses of the
    file the camera was read from, in `extra`, are left out: they refer to the frame before.

    Raises
    ------
    ValueError
        If the camera model has no parameters for it.
    """
    bearings, pixels = _samples(camera, None)
    flipped = bearings * (-1.0, 1.0, 1.0)
    params = type(camera.model).fit(flipped, pixels).params
    if params.shape == camera.model.params.shape:
        # Some parameters change their sign; the fit finds which, and differs from the exact values by rounding.
        signs = np.where(params * camera.model.params < 0, -1.0, 1.0)
        covariance = None if camera.covariance is None else camera.covariance * np.outer(signs, signs)
        result = dataclasses.replace(
            camera,
            model=camera.model.with_params(signs * camera.model.params),
            covariance=covariance,
            extra=reflected_fields(camera.extra),
        )
        if _compare(result, flipped, pixels).max_px <= MAX_FLIP_PX:
            return result
    raise ValueError(
        f"the model {camera.model.name} has no parameter that exchanges left and right: convert the camera to another"
        " one, such as radial_polynomial or unified"
    )


def _samples(camera: Camera, theta_max: float | None) -> tuple[Array, Array]:
    """Return bearings (N, 3) and pixels (N, 2) of a camera over its image."""
    if camera.width < 1 or camera.height < 1:
        raise ValueError("the image size is not known, so there is no field of view to fit over")
    bearings, pixels = camera.samples(theta_max, GRID)
    if len(bearings) < MIN_DENSE_SAMPLES:  # a narrow field of view in a wide image
        bearings, pixels = camera.samples(theta_max, DENSE_GRID)
    if len(bearings) < MIN_SAMPLES:
        raise ValueError("almost no pixel of the camera lies inside this field of view")
    return bearings, pixels


def _compare(camera: Camera, bearings: Array, pixels: Array) -> Conversion:
    """Compare a camera with the bearings and pixels of another one."""
    projected, valid = camera.model.project_numpy(bearings)
    distance = np.where(valid, np.linalg.norm(np.where(valid[:, None], projected, 0) - pixels, axis=1), np.inf)
    unprojected, valid = camera.model.unproject_numpy(pixels)
    chord = np.linalg.norm(unprojected - bearings, axis=1)
    angle = np.where(valid, np.degrees(2 * np.arcsin(np.clip(chord / 2, 0, 1))), np.inf)
    theta = np.arccos(np.clip(bearings[:, 2], -1, 1))
    differing, missing = theta[distance > AGREEMENT_PX], theta[np.isinf(distance)]
    return Conversion(
        camera=camera,
        theta_max=float(theta.max()),
        max_px=float(distance.max()),
        rms_px=float(np.sqrt((distance**2).mean())),
        mean_px=float(distance.mean()),
        max_deg=float(angle.max()),
        rms_deg=float(np.sqrt((angle**2).mean())),
        worst_theta=float(missing.min() if missing.size else theta[np.argmax(distance)]),
        agreement_theta=float(differing.min() if differing.size else theta.max()),
    )


def max_convertible_theta(camera: Camera, model: str, max_px: float, *, theta_max: float | None = None) -> float | None:
    """Return the largest angle from the axis (radians) up to which a model represents a camera; None if none does.

    The field of view is bisected to a third of a degree; the model is refitted to each.

    Parameters
    ----------
    camera, model, theta_max
        As for `convert_model`.
    max_px
        The largest distance of the pixels of equal bearings.
    """

    def represents(limit: float) -> bool:
        try:
            return convert_model(camera, model, theta_max=limit).max_px <= max_px
        except ValueError:
            return False

    high = convert_model(camera, camera.model.name, theta_max=theta_max).theta_max
    low = MIN_THETA_MAX_RAD
    if not represents(low):
        return None
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if represents(middle) else (low, middle)
    return low


def rank_conversions(camera: Camera, models: Sequence[str], *, theta_max: float | None = None) -> list[Conversion]:
    """Convert a camera to each model that can be fitted to it, the most accurate first; see `convert_model`."""
    if not all(camera.size):
        raise ValueError("the image size is not known, over which models are fitted: add it to the file")
    conversions: list[Conversion] = []
    for model in models:
        try:
            conversions.append(convert_model(camera, model, theta_max=theta_max))
        except ValueError:
            continue
    if not conversions:
        raise ValueError(f"none of the models {', '.join(models)} can be fitted to this {camera.model.name} camera")
    return sorted(conversions, key=lambda conversion: conversion.max_px)

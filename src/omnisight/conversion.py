"""One camera in the terms of another model."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnisight.camera import Camera
from omnisight.models import model_class

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conversion:
    """A camera fitted to another one.

    Attributes
    ----------
    camera
        The fitted camera.
    theta_max
        The cone (radians from the axis) that the fit was made over: the calibrated one, or the whole image.
    max_px, rms_px, mean_px
        Distance of the pixels of equal bearings over that cone; inf where the fitted camera has none.
    max_deg, rms_deg
        Angle between the bearings of equal pixels there, degrees.
    worst
        The angle (radians) at which `max_px` is met, or the fitted camera's pixels begin to lack.
    holds_to
        The angle (radians) up to which the pixels agree within half a pixel.
    """

    camera: Camera
    theta_max: float
    max_px: float
    rms_px: float
    mean_px: float
    max_deg: float
    rms_deg: float
    worst: float
    holds_to: float


AGREES_PX = 0.5
ENOUGH, DENSER = 100, 161  # samples, and how many across the image where that is too few
NARROWEST = np.radians(5.0)  # cone that is still worth a fit
HALVINGS = 8  # of the cone, to a third of a degree


def convert_model(camera: Camera, model: str, *, theta_max: float | None = None) -> Conversion:
    """Fit another camera model to a camera, over its calibrated cone.

    Parameters
    ----------
    camera
        What to convert.
    model
        The model to convert to.
    theta_max
        Fit over this cone (radians) instead of the calibrated one.

    Raises
    ------
    ValueError
        If the model is unknown or cannot be fitted at all.
    """
    cls = model_class(model)
    if camera.width < 1 or camera.height < 1:
        raise ValueError("the camera's file does not say how large its images are, so there is nothing to fit over")
    bearings, pixels = camera.samples(theta_max)
    if len(bearings) < ENOUGH:  # of a narrow cone in a wide image
        bearings, pixels = camera.samples(theta_max, DENSER)
    if len(bearings) < 20:
        raise ValueError("the camera sees almost nothing of its image inside that cone")
    try:
        fitted = camera.model if cls is type(camera.model) else cls.fit(bearings, pixels)
    except np.linalg.LinAlgError as error:
        raise ValueError(f"{model} cannot be fitted to this {camera.model.name} camera: {error}") from error
    seen, valid = fitted.project_numpy(bearings)
    distance = np.where(valid, np.linalg.norm(np.where(valid[:, None], seen, 0) - pixels, axis=1), np.inf)
    back, shown = fitted.unproject_numpy(pixels)
    angle = np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(back - bearings, axis=1) / 2, 0, 1)))
    theta = np.arccos(np.clip(bearings[:, 2], -1, 1))
    apart = theta[distance > AGREES_PX]
    lost = theta[np.isinf(distance)]
    converted = camera
    if cls is not type(camera.model):
        converted = dataclasses.replace(
            camera,
            model=fitted,
            theta_max=camera.theta_max if theta_max is None else theta_max,
            covariance=None,
            provenance={
                **camera.provenance,
                "converted_from": camera.model.name,
                "conversion_max_px": float(distance.max()) if not lost.size else None,
            },
        )
    return Conversion(
        camera=converted,
        theta_max=float(theta.max()),
        max_px=float(distance.max()),
        rms_px=float(np.sqrt((distance**2).mean())),
        mean_px=float(distance.mean()),
        max_deg=float(np.max(np.where(shown, angle, np.inf))),
        rms_deg=float(np.sqrt((np.where(shown, angle, np.inf) ** 2).mean())),
        worst=float(lost.min() if lost.size else theta[np.argmax(distance)]),
        holds_to=float(apart.min() if apart.size else theta.max()),
    )


def reach(camera: Camera, model: str, max_px: float, *, theta_max: float | None = None) -> float | None:
    """Give the widest cone (radians) over which a model, fitted to that cone alone, stays that near; None if none does.

    By halving between the narrowest cone worth a fit and the given one, to a third of a degree.

    Parameters
    ----------
    camera, model, theta_max
        As `convert_model`.
    max_px
        How far the pixels of equal bearings may be apart.
    """

    def holds(limit: float) -> bool:
        try:
            return convert_model(camera, model, theta_max=limit).max_px <= max_px
        except ValueError:
            return False

    wide = convert_model(camera, camera.model.name, theta_max=theta_max).theta_max
    near = NARROWEST
    if not holds(near):
        return None
    for _ in range(HALVINGS):
        middle = (near + wide) / 2
        near, wide = (middle, wide) if holds(middle) else (near, middle)
    return near


def conversions(camera: Camera, models: Sequence[str], *, theta_max: float | None = None) -> list[Conversion]:
    """Convert a camera to each of the models that can be fitted to it, the nearest first; see `convert_model`."""
    found: list[Conversion] = []
    for model in models:
        try:
            found.append(convert_model(camera, model, theta_max=theta_max))
        except ValueError:
            continue
    if not found:
        raise ValueError(f"none of the models {', '.join(models)} can be fitted to this {camera.model.name} camera")
    return sorted(found, key=lambda conversion: conversion.max_px)

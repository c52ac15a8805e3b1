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
        The cone (radians from the axis) that the fit was made over: the calibrated one, or the whole picture.
    max_px, mean_px
        Distance of the pixels of equal bearings over that cone.
    max_deg
        The largest angle between the bearings of equal pixels there.
    holds_to
        The angle (radians) up to which the pixels agree within half a pixel.
    """

    camera: Camera
    theta_max: float
    max_px: float
    mean_px: float
    max_deg: float
    holds_to: float


AGREES_PX = 0.5


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
        raise ValueError("the camera's file does not say how large its pictures are, so there is nothing to fit over")
    bearings, pixels = camera.samples(theta_max)
    if len(bearings) < 20:
        raise ValueError("the camera sees almost nothing of its picture inside that cone")
    fitted = camera.model if cls is type(camera.model) else cls.fit(bearings, pixels)
    seen, valid = fitted.project_numpy(bearings)
    distance = np.where(valid, np.linalg.norm(np.where(valid[:, None], seen, 0) - pixels, axis=1), np.inf)
    back, shown = fitted.unproject_numpy(pixels)
    angle = np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(back - bearings, axis=1) / 2, 0, 1)))
    theta = np.arccos(np.clip(bearings[:, 2], -1, 1))
    apart = theta[distance > AGREES_PX]
    provenance = {**camera.provenance, "converted_from": camera.model.name}
    same = cls is type(camera.model)
    return Conversion(
        camera if same else dataclasses.replace(camera, model=fitted, covariance=None, provenance=provenance),
        float(theta.max()),
        float(distance.max()),
        float(distance[np.isfinite(distance)].mean()) if np.isfinite(distance).any() else float("inf"),
        float(np.max(np.where(shown, angle, np.inf))),
        float(apart.min() if apart.size else theta.max()),
    )


def conversions(camera: Camera, models: Sequence[str], *, theta_max: float | None = None) -> list[Conversion]:
    """Convert a camera to each of the models that can be fitted to it, the nearest first; see `convert_model`."""
    found: list[Conversion] = []
    for model in models:
        try:
            found.append(convert_model(camera, model, theta_max=theta_max))
        except (ValueError, np.linalg.LinAlgError):
            continue
    if not found:
        raise ValueError(f"none of the models {', '.join(models)} can be fitted to this {camera.model.name} camera")
    return sorted(found, key=lambda conversion: conversion.max_px)

"""Bundle adjustment of the same corners from the same initial values, compared with cv2.omnidir."""

import cv2
import numpy as np

import omnisight as om
from benchmarks.race import Race, race
from omnisight.calibration.bundle_adjustment import refine
from omnisight.calibration.free_parameters import FreeParameters
from omnisight.calibration.state import State
from omnisight.geometry.rotation import exp

SIZE = (1032, 778)


def boards(count: int = 15) -> tuple[om.Observations, om.CameraModel, np.ndarray, np.ndarray]:
    """Project boards of 8x6 corners through a Mei camera, with 0.2 px of noise."""
    rng = np.random.default_rng(1)
    camera = om.model_class("mei")(700.0, 699.0, 543.0, 378.0, 1.2, -0.1, 0.03, 3e-4, -2e-4)
    grid = np.stack(np.meshgrid(np.arange(8.0), np.arange(6.0)), -1).reshape(-1, 2)
    points = np.concatenate([grid, np.zeros((48, 1))], -1) * 0.0325
    views, rotations, translations = [], [], []
    while len(views) < count:
        rotation = exp(rng.normal(size=3) * 0.35)
        translation = rng.uniform((-0.3, -0.25, 0.2), (0.1, 0.05, 0.5))
        pixels, valid = camera.project(points @ rotation.T + translation)
        if valid.all() and (pixels > 0).all() and (pixels < SIZE).all():
            views.append((points, pixels + 0.2 * rng.normal(size=pixels.shape)))
            rotations.append(rotation)
            translations.append(translation)
    observations = om.Observations.from_arrays(*zip(*views, strict=True), size=SIZE)
    return observations, camera, np.array(rotations), np.array(translations)


def run() -> list[Race]:
    views, truth, rotations, translations = boards()
    rough = truth.with_params(np.array([640.0, 640.0, 515.5, 388.5, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    start = State(rough, rotations @ exp([0.02, -0.02, 0.01]), translations * 1.03)
    free_parameters = FreeParameters.of(truth, free=["skew"])
    objects = [views.points[g][None] for g in views.groups]
    images = [views.pixels[g][None] for g in views.groups]

    def theirs() -> object:
        return cv2.omnidir.calibrate(
            objects, images, SIZE, None, None, None, 0, (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-8)
        )

    ours = refine(start, views, free_parameters=free_parameters, loss="squared")
    rms = float(np.sqrt((ours.state.lengths(views) ** 2).mean()))
    note = f"rms {rms:.4f} px against {theirs()[0]:.4f}, which starts by itself"
    return [
        race(
            "refine 15 views x 48 corners, Mei",
            lambda: refine(start, views, free_parameters=free_parameters, loss="squared"),
            theirs,
            "cv2.omnidir.calibrate",
            3,
            runs=7,
            note=note,
        )
    ]

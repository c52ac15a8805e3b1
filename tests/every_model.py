"""Cameras of every model, and bearings that they see. Nothing here lists the models."""

import re

import numpy as np
import pytest

from omnisight.models import model_class, model_names

# Shapes on which formulas change their form or lose a term, beside the example and cameras near it.
EDGES = {
    "division": [{"k": 0.0}, {"k": 1e-9}, {"k": 0.05}, {"k": -2.0}],
    "double_sphere": [
        {"xi": 0.0, "alpha": 0.0},
        {"xi": 0.0, "alpha": 0.5},
        {"xi": 0.3, "alpha": 0.2},
        {"xi": 1.4, "alpha": 0.6},
    ],
    "eucm": [{"alpha": 0.0}, {"alpha": 0.5, "beta": 2.0}, {"alpha": 0.3, "beta": 0.5}, {"alpha": 0.9}],
    "fisheye624": [{f"k{i}": 0.0 for i in range(1, 7)}],
    "fov": [{"omega": 0.05}, {"omega": np.pi / 2}, {"omega": 3.0}],
    "kannala_brandt": [
        {"k1": 0.0, "k2": 0.0, "k3": 0.0, "k4": 0.0},
        {"k1": 0.1, "k2": 0.05, "k3": 0.01, "k4": 0.001},
        {"k1": -0.15, "k2": 0.0, "k3": 0.0, "k4": 0.0},
    ],
    "mei": [
        {"xi": 1.0},
        {"xi": 0.6},
        {"xi": 2.2},
        {"xi": 1.8, "k1": 0.1, "k2": 0.0},
        {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
    ],
    "ocam": [{"a2": 0.0, "a3": 0.0, "a4": 0.0}, {"a2": -2.1e-3, "a3": 0.0, "a4": 0.0}],
    "panini": [{"d": 0.0}, {"d": 1.0}, {"d": 2.5}],
    "radial_tangential": [{"k1": 0.1, "k2": 0.02, "k3": 0.0}],
    "thin_prism_fisheye": [dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2", "s1", "s2"), 0.0)],
    "unified": [{"xi": xi} for xi in (-0.4, 0.0, 1.0, 1.000001, 2.5)],
}


def cameras(name):
    """Return the example, three cameras near it, and those of `EDGES`."""
    example = model_class(name).example()
    rng = np.random.default_rng(sum(name.encode()))
    yield example
    for _ in range(3):
        size = [0.05 if re.fullmatch(r"a\d+", p.name) else 0.2 for p in example.parameters]
        params = example.params * (1 + size * rng.uniform(-1, 1, len(size)))
        yield example.with_params(np.clip(params, *bounds(example)))
    for edge in EDGES.get(name, ()):
        yield type(example).from_dict(example.to_dict() | edge)


def bounds(model):
    return [p.low for p in model.parameters], [p.high for p in model.parameters]


CAMERAS = [pytest.param(camera, id=f"{name}-{i}") for name in model_names() for i, camera in enumerate(cameras(name))]
EXAMPLES = [pytest.param(model_class(name).example(), id=name) for name in model_names()]
every_camera = pytest.mark.parametrize("model", CAMERAS)
every_model = pytest.mark.parametrize("model", EXAMPLES)

AZIMUTHS = np.linspace(-np.pi, np.pi, 24, endpoint=False) + 0.05


def direction(theta, phi):
    """Return bearings (..., 3) from angles off the axis and azimuths."""
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def rim(model):
    """Return the angle at which the valid domain ends for every azimuth, by bisection."""
    low, high = np.zeros_like(AZIMUTHS), np.full_like(AZIMUTHS, np.pi)
    low[model.project(direction(high, AZIMUTHS))[1]] = np.pi
    for _ in range(60):
        middle = (low + high) / 2
        valid = model.project(direction(middle, AZIMUTHS))[1]
        low, high = np.where(valid, middle, low), np.where(valid, high, middle)
    return low


def inside(model, share=0.9, count=60):
    """Return bearings (count, 3) inside the valid domain, near the axis and far from it."""
    rng = np.random.default_rng(7)
    which = rng.integers(len(AZIMUTHS), size=count)
    bearings = direction(rng.uniform(0, share, count) * rim(model)[which], AZIMUTHS[which])
    # On the axis, unless r(theta) has no second derivative there.
    bearings[0] = direction(0.01 if model.name == "radial_polynomial" else 0.0, 0.3)
    return bearings

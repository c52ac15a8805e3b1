"""Headings and places of the visual compass on a robot's route and on rendered panoramas.

`python -m benchmarks compass` prints the tables of docs/guide/compass.md. The peer is the rotational image difference
with a perfect memory (J. Zeil et al., 2003): the reference and the rotation by whole columns with the smallest mean
squared difference of gray values. The variable OMNISIGHT_DATA names the folder of the real images, without which the
robot's route is left out.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import omnisight as om
from omnisight.geometry import rotation as so3
from omnisight.images import to_gray8
from omnisight.places.panorama_rotation import wrap_deg
from omnisight.places.panorama_signature import PanoramaSignature
from omnisight.places.visual_compass import VisualCompass
from omnisight.simulation import Renderer, scene_named

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

DATA = Path(os.environ.get("OMNISIGHT_DATA", Path(__file__).resolve().parent.parent.parent / "shared/data"))
# Half-width of the local quadratic fit to the tracked path, whose noise is about 5 cm, and the scale of outliers.
SMOOTHING_S, FIT_ITERATIONS, OUTLIER_SCALE = 2.0, 4, 1.5
# Until the robot moves, its path has no direction.
FIRST_MOVING = 20
# Rendered panoramas: queries per scene, and the largest distances from the reference, metres.
QUERIES, DISTANCES = 40, (0.05, 0.2, 0.5, 2.0)
# Those at which the queries are also lit from one side.
LIT_DISTANCES = (0.2, 0.5)
CAMERA = om.sphere(240)


class Located(NamedTuple):
    """Reference, heading (degrees) and standard deviation of one query."""

    reference: int
    heading: float
    sigma: float = float("nan")


Method = Callable[[Sequence[Image], Sequence[Image]], list[Located]]


def ours(queries: Sequence[Image], references: Sequence[Image]) -> list[Located]:
    """Locate queries with omnisight."""
    weights = _row_weights(references[0])
    compass = VisualCompass([PanoramaSignature(image, weights) for image in references])
    found = [compass.locate(PanoramaSignature(image, weights)) for image in queries]
    return [Located(k, rotation.yaw_deg, rotation.sigma_deg) for k, rotation in found]


def image_difference(queries: Sequence[Image], references: Sequence[Image]) -> list[Located]:
    """Locate queries by the smallest mean squared difference over all references and rotations by whole columns."""
    stack = np.array(references, float)
    spectra, energy = np.fft.rfft(stack), (stack**2).sum((1, 2))
    found: list[Located] = []
    for image in queries:
        products = np.einsum("hf,nhf->nf", np.fft.rfft(image.astype(float)).conj(), spectra)
        difference = energy[:, None] - 2 * np.fft.irfft(products, n=image.shape[1])
        reference, shift = np.unravel_index(difference.argmin(), difference.shape)
        found.append(Located(int(reference), 360.0 * float(shift) / image.shape[1]))
    return found


METHODS: dict[str, Method] = {"omnisight": ours, "image difference": image_difference}


def _row_weights(image: Image) -> Array | None:
    height, width = image.shape
    return np.cos(np.pi * ((np.arange(height) + 0.5) / height - 0.5)) if width == 2 * height else None


def route() -> tuple[list[Image], Array, Array]:
    """Return the panoramas of the robot's route, their distance along it (cm) and the direction of the path (degrees).

    The tracked path is noisy, so that its direction is that of a local quadratic fit, robust against outliers. The
    y axis of path.csv points down, and the camera is fixed to the robot: differences of directions are headings.
    """
    folder = DATA / "robot_route"
    rows = [line.split(",") for line in (folder / "snapshots.csv").read_text().splitlines()[1:]]
    images = [to_gray8(om.read_image(folder / row[1].strip())) for row in rows]
    path = np.genfromtxt(folder / "path.csv", delimiter=",", skip_header=1)
    places, velocities = np.array([_smoothed(path, 1000 * float(row[0])) for row in rows]).swapaxes(0, 1)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    direction = np.degrees(np.arctan2(velocities[:, 1], velocities[:, 0]))
    return images, np.concatenate([[0.0], np.cumsum(steps)]), direction


def _smoothed(path: Array, time_ms: float) -> tuple[Array, Array]:
    """Return place and velocity on the path at a time."""
    offset = (path[:, 0] - time_ms) / (1000 * SMOOTHING_S)
    near = np.abs(offset) < 1
    kernel = (1 - np.abs(offset[near]) ** 3) ** 3
    powers, weights = np.vander(offset[near], 3, increasing=True), kernel
    fit = np.zeros((3, 2))
    for _ in range(FIT_ITERATIONS):
        root = np.sqrt(weights)[:, None]
        fit = np.linalg.lstsq(root * powers, root * path[near, 1:], rcond=None)[0]
        residual = np.linalg.norm(path[near, 1:] - powers @ fit, axis=1)
        weights = kernel / (1 + (residual / (OUTLIER_SCALE * np.median(residual))) ** 2)
    return fit[0], fit[1]


def print_route() -> None:
    """Print headings and places on the robot's route."""
    images, along, direction = route()
    count = len(images)
    every, middle = np.arange(FIRST_MOVING, count), (FIRST_MOVING + count) // 2
    sets = {
        "every second image": (every[1::2], every[::2]),
        "every 20th image": (np.setdiff1d(every, every[::20]), every[::20]),
        "first half": (every[every >= middle], every[every < middle]),
    }
    print("| references | method | heading ° | 95 % | place cm | 95 % | order |\n" + "|---" * 7 + "|")
    for name, (queries, references) in sets.items():
        for method, locate in METHODS.items():
            found = locate([images[i] for i in queries], [images[i] for i in references])
            print(f"| {name} | {method} | {_errors(found, queries, references, along, direction)} |", flush=True)
    queries, references = sets["every 20th image"]
    print("\n| change of the query | method | heading ° | 95 % | place cm | 95 % | order |\n" + "|---" * 7 + "|")
    for name, change in changes(np.random.default_rng(0)).items():
        before, changed = [images[i] for i in references], [change(images[i]) for i in queries]
        if name == "half the size":  # also of the references
            before = [change(each) for each in before]
        for method, locate in METHODS.items():
            found = locate(changed, before)
            print(f"| {name} | {method} | {_errors(found, queries, references, along, direction)} |", flush=True)


def changes(rng: np.random.Generator) -> dict[str, Callable[[Image], Image]]:
    """Return changes of an image, as of another run of the robot."""
    import cv2

    def exposed(image: Image) -> Image:
        return np.clip(rng.uniform(0.5, 1.5) * image + rng.uniform(-30, 30), 0, 255).astype(np.uint8)

    def halved(image: Image) -> Image:
        size = image.shape[1] // 2, image.shape[0] // 2
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)

    def masked(share: float) -> Callable[[Image], Image]:
        return lambda image: np.where(np.arange(image.shape[1]) < share * image.shape[1], 0, image).astype(np.uint8)

    return {
        "gamma 2": lambda image: (255 * (image / 255) ** 2).astype(np.uint8),
        "gain and offset of each": exposed,
        "noise of 25 gray values": lambda image: np.clip(image + rng.normal(0, 25, image.shape), 0, 255).astype(
            np.uint8
        ),
        "half the size": halved,
        "a quarter masked": masked(0.25),
        "half masked": masked(0.5),
    }


def _errors(
    found: Sequence[Located], queries: NDArray[np.intp], references: NDArray[np.intp], along: Array, direction: Array
) -> str:
    """Return the cells of headings and places on the route."""
    from scipy.stats import spearmanr

    nearest = references[[each.reference for each in found]]
    turned = direction[queries] - direction[nearest]
    error = np.abs([wrap_deg(each.heading - t) for each, t in zip(found, turned, strict=True)])
    away = np.abs(along[queries] - along[nearest])
    order = float(spearmanr(along[queries], along[nearest]).statistic)
    cells = [np.median(error), np.quantile(error, 0.95), np.median(away), np.quantile(away, 0.95), order]
    return " | ".join(f"{value:.{digits}f}" for value, digits in zip(cells, (2, 1, 1, 1, 4), strict=True))


def shoot(scene: str, distance: float, rng: np.random.Generator) -> tuple[list[Image], list[Image], Array]:
    """Render references, and queries at a distance from them with random headings; return these too."""
    found = scene_named(scene)
    low, high = (np.asarray(corner, float) for corner in found.free)
    references: list[Image] = []
    queries: list[Image] = []
    headings = rng.uniform(-180, 180, QUERIES)
    for heading in headings:
        place, azimuth = rng.uniform(low, high), rng.uniform(0, 2 * np.pi)
        place[1] = (low[1] + high[1]) / 2
        moved = place + distance * np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
        for images, centre, yaw in ((references, place, 0.0), (queries, moved, heading)):
            pose = om.Pose(so3.exp([0.0, np.radians(yaw), 0.0]), centre)
            images.append(to_gray8(Renderer(CAMERA, pose, found, samples=1)(rng=rng).image))
    return queries, references, headings


def lit_from_one_side(image: Image, rng: np.random.Generator) -> Image:
    """Return an image whose gray values are up to 50 % larger on one side, and smaller on the other one."""
    width = image.shape[1]
    light = 1 + 0.5 * np.sin(2 * np.pi * np.arange(width) / width + rng.uniform(0, 2 * np.pi))
    return np.clip(image * light / 1.2, 0, 255).astype(np.uint8)


def print_rendered(scenes: Sequence[str], distances: Sequence[float]) -> None:
    """Print heading errors of rendered panoramas relative to the reference at a distance."""
    print("\n| scene, distance | method | heading ° | 95 % | median σ ° | within 1, 2, 3σ % |\n" + "|---" * 6 + "|")
    for scene in scenes:
        for distance in distances:
            queries, references, headings = shoot(scene, distance, np.random.default_rng(0))
            _print_headings(f"{scene}, {distance:g} m", queries, references, headings)
            if distance in LIT_DISTANCES:
                lit = [lit_from_one_side(query, np.random.default_rng(k)) for k, query in enumerate(queries)]
                _print_headings(f"{scene}, {distance:g} m, light", lit, references, headings)


def _print_headings(name: str, queries: Sequence[Image], references: Sequence[Image], headings: Array) -> None:
    """Print a row for each method."""
    for method, locate in METHODS.items():
        found = [locate([q], [r])[0] for q, r in zip(queries, references, strict=True)]
        error = np.abs([wrap_deg(each.heading - true) for each, true in zip(found, headings, strict=True)])
        sigma = np.array([each.sigma for each in found])
        within = ", ".join(f"{100 * np.mean(error < k * sigma):.0f}" for k in (1, 2, 3))
        stated = f"{np.median(sigma):.2f} | {within}" if np.isfinite(sigma).all() else "- | -"
        print(f"| {name} | {method} | {np.median(error):.2f} | {np.quantile(error, 0.95):.1f} | {stated} |", flush=True)


def main(arguments: Sequence[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks compass", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the route, and panoramas of the room at one distance")
    quick = parser.parse_args(arguments).quick
    if (DATA / "robot_route").is_dir():
        print_route()
    print_rendered(("room",) if quick else ("room", "street"), DISTANCES[1:2] if quick else DISTANCES)


if __name__ == "__main__":
    main(sys.argv[1:])

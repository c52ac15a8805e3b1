"""A million points there and back, against OpenCV and pycolmap."""

import cv2
import numpy as np

import omnisight as om
from benchmarks.race import Race, race

COUNT = 1_000_000
K = np.array([[478.0, 0.0, 512.0], [0.0, 476.0, 384.0], [0.0, 0.0, 1.0]])
MEI = np.array([-0.11, 0.03, 3e-4, -2e-4])
KB = np.array([0.03, -0.011, 0.0021, -0.00019])


def bearings(limit: float) -> np.ndarray:
    rng = np.random.default_rng(0)
    theta, phi = limit * np.sqrt(rng.uniform(size=COUNT)), rng.uniform(0, 2 * np.pi, COUNT)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


def run() -> list[Race]:
    return [*_opencv(), *_colmap(), *_small()]


def _opencv() -> list[Race]:
    zero = np.zeros((1, 3))
    mei = om.model_class("mei").from_dict(
        {"fx": 478.0, "fy": 476.0, "cx": 512.0, "cy": 384.0, "xi": 1.07}
        | dict(zip(("k1", "k2", "p1", "p2"), map(float, MEI), strict=True))
    )
    fisheye = om.model_class("kannala_brandt").from_dict(
        {"fx": 478.0, "fy": 476.0, "cx": 512.0, "cy": 384.0} | {f"k{i + 1}": float(k) for i, k in enumerate(KB)}
    )
    ocam = om.model_class("ocam").example()
    points = bearings(1.4)
    column = points[:, None]
    pixels, _ = mei.project(points)

    def omnidir() -> object:
        return cv2.omnidir.projectPoints(column, zero, zero, K, 1.07, MEI)

    same = float(np.abs(omnidir()[0][:, 0] - pixels).max())
    back = cv2.omnidir.undistortPoints(pixels[:, None], K, MEI, np.array([1.07]), np.eye(3))[:, 0]
    ours, _ = mei.unproject(pixels)
    off = float(np.abs(ours - points).max())
    theirs = back / np.linalg.norm(back, axis=1)[:, None] if back.shape[1] == 3 else None
    note = f"ours closes to {off:.1e} rad" + (
        "" if theirs is None else f", theirs to {np.nanmax(abs(theirs - points)):.1e}"
    )
    return [
        race(
            "project 1 M, Mei", lambda: mei.project(points), omnidir, "cv2.omnidir", 25, note=f"equal to {same:.0e} px"
        ),
        race(
            "unproject 1 M, Mei",
            lambda: mei.unproject(pixels),
            lambda: cv2.omnidir.undistortPoints(pixels[:, None], K, MEI, np.array([1.07]), np.eye(3)),
            "cv2.omnidir",
            25,
            note=note,
        ),
        race(
            "project 1 M, Kannala-Brandt",
            lambda: fisheye.project(points),
            lambda: cv2.fisheye.projectPoints(column, zero, zero, K, KB),
            "cv2.fisheye",
            6,
        ),
        race("project 1 M, ocam (exact) against Mei", lambda: ocam.project(points), omnidir, "cv2.omnidir", 5),
    ]


def _colmap() -> list[Race]:
    try:
        import pycolmap
    except ImportError:
        print("pycolmap is not installed: left out")
        return []
    cases = (
        ("EUCM", "eucm", [317.0, 316.0, 640.0, 512.0, 0.62, 1.08], (5, 5)),
        ("OPENCV_FISHEYE", "kannala_brandt", [478.0, 476.0, 512.0, 384.0, *KB], (3, 8)),
        ("EQUIRECTANGULAR", "equirectangular", [4000.0, 2000.0], (2, None)),
    )
    races: list[Race] = []
    for theirs, ours, params, (forth, back) in cases:
        model = om.model_class(ours)
        if theirs == "EQUIRECTANGULAR":
            camera = model(4000 / (2 * np.pi), 2000 / np.pi, 1999.5, 999.5)
            peer = pycolmap.Camera(model=theirs, width=4000, height=2000, params=params)
        else:
            shifted = np.array(params)
            shifted[2:4] += 0.5
            camera = model.example().with_params(params)
            peer = pycolmap.Camera(model=theirs, width=1280, height=1024, params=shifted)
        points = bearings(1.4)
        pixels, _ = camera.project(points)
        theirs_pixels = peer.img_from_cam(points)
        note = f"equal to {np.nanmax(np.abs(theirs_pixels - 0.5 - pixels)):.0e} px"
        races.append(
            race(
                f"project 1 M, {theirs}",
                lambda camera=camera, points=points: camera.project(points),
                lambda peer=peer, points=points: peer.img_from_cam(points),
                "pycolmap, 1 thread",
                forth,
                note=note,
            )
        )
        if back:
            shifted_pixels = pixels + 0.5
            races.append(
                race(
                    f"unproject 1 M, {theirs}",
                    lambda camera=camera, pixels=pixels: camera.unproject(pixels),
                    lambda peer=peer, pixels=shifted_pixels: peer.cam_from_img(pixels),
                    "pycolmap, 1 thread",
                    back,
                )
            )
    return races


def _small() -> list[Race]:
    """Time 1000 points through every model; the peer is a clock of 50 microseconds."""
    import time

    rng = np.random.default_rng(0)
    points = rng.normal(size=(1000, 3)) * (0.3, 0.3, 0.1) + (0, 0, 1)
    worst, slowest = 0.0, ""
    for name in om.model_names():
        model = om.model_class(name).example()
        model.project(points)
        times = []
        for _ in range(200):
            begun = time.perf_counter()
            model.project(points)
            times.append(time.perf_counter() - begun)
        if np.median(times) > worst:
            worst, slowest = float(np.median(times)), name
    return [Race(f"project 1000, slowest model ({slowest})", worst, 50e-6, "50 us", 1)]

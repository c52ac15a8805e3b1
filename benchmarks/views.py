"""Maps and remaps, against OpenCV."""

import cv2
import numpy as np

import omnisight as om
from benchmarks.points import MEI, K
from benchmarks.race import Race, race
from omnisight.views.maps import view_map


def run() -> list[Race]:
    lens = om.model_class("mei")(478.0, 476.0, 512.0, 384.0, 1.07, *map(float, MEI))
    source = om.Camera(lens, (1024, 768))
    flat = om.perspective((1920, 1080), 90)
    new_k = np.array([[flat.model.fx, 0, flat.model.cx], [0, flat.model.fy, flat.model.cy], [0, 0, 1]])

    def theirs() -> object:
        return cv2.omnidir.initUndistortRectifyMap(
            K, MEI, np.array([1.07]), np.eye(3), new_k, (1920, 1080), cv2.CV_32FC1, cv2.omnidir.RECTIFY_PERSPECTIVE
        )

    ours_u, _ = view_map(source, flat, np.eye(3))
    theirs_u = theirs()[0]
    note = f"equal to {np.nanmax(np.abs(ours_u - theirs_u)):.0e} px"
    races = [
        race(
            "1080p map, Mei to perspective",
            lambda: view_map(source, flat, np.eye(3)),
            theirs,
            "cv2.omnidir",
            5,
            note=note,
        )
    ]
    rng = np.random.default_rng(0)
    image = cv2.resize(rng.integers(0, 255, (270, 480, 3), np.uint8), (3840, 2160), interpolation=cv2.INTER_CUBIC)
    wide = om.Camera(
        om.model_class("kannala_brandt")(1300.0, 1300.0, 1919.5, 1079.5, 0.01, 0.0, 0.0, 0.0), (3840, 2160)
    )
    view = om.perspective((1920, 1080), 75)
    remapper = om.Remapper(wide, view, antialias=False)
    u, v = view_map(wide, view, np.eye(3))
    first, second = cv2.convertMaps(u, v, cv2.CV_16SC2)
    races.append(
        race(
            "remap 4K to 1080p, RGB, bilinear, map kept",
            lambda: remapper(image),
            lambda: cv2.remap(image, first, second, cv2.INTER_LINEAR),
            "cv2.remap, fixed point",
            0.95,
            runs=41,
        )
    )
    return races

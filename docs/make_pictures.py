"""Draws the pictures of the README and the documentation, from rendered scenes only: the same at every run."""

import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulate import BOARD, BoardInScene, Setup, fisheye_setup, mirror_setup

ASSETS = Path(__file__).parent / "assets"
GAP = 10


def main() -> None:
    """Draw all pictures."""
    ASSETS.mkdir(exist_ok=True)
    om.write_image(ASSETS / "hero.jpg", hero())
    om.write_image(ASSETS / "mirror.jpg", mirror())
    om.write_image(ASSETS / "next.jpg", next_picture())


def hero() -> np.ndarray:
    """A fisheye picture beside views of it: the board laid flat, the window, and half of the room around."""
    setup = fisheye_setup(1440)
    picture = shoot(setup, held(yaw=-37, pitch=-20, turn=(0.25, 0.45, -0.16), distance=0.8))

    def view(target: om.Camera, yaw: float = 0, pitch: float = 0) -> np.ndarray:
        rotation = om.look(yaw, pitch)
        return om.remap(picture, setup.camera, target, rotation, interpolation="bicubic")

    top = beside(view(om.perspective(70, (470, 300)), -33, -10), view(om.perspective(66, (470, 300)), 42, 2))
    wide = view(om.cylinder(top.shape[1], elevation=(-32, 28), azimuth=(-92, 92)))
    views = below(top, wide)
    whole = om.remap(picture, setup.camera, om.fisheye(len(views), 191), interpolation="bicubic")
    return beside(whole, views)


def mirror() -> np.ndarray:
    """The picture of a mirror, and all that is around it on a cylinder."""
    setup = mirror_setup(1440)
    picture = shoot(setup)
    around = om.cylinder(1240, elevation=(-55, 18))
    unrolled = om.remap(picture, setup.camera, around, om.look(up="back"), interpolation="bicubic")
    u, v = round(setup.camera.model.to_dict()["cx"]), round(setup.camera.model.to_dict()["cy"])
    half = 536
    return beside(shrunk(picture[max(v - half, 0) : v + half, u - half : u + half], unrolled.shape[0]), unrolled)


def next_picture() -> np.ndarray:
    """Where to hold the board next, after seven pictures with it on the right."""
    from omnisight.cli.calibrate import calibrate
    from omnisight.cli.next import next as propose

    setup = fisheye_setup(960)
    render = setup.renderer(samples=2)
    yaws, pitches = (8, 25, 40, 55, 30, 15, 45), (5, -25, 10, -5, 30, -10, -30)
    with tempfile.TemporaryDirectory() as place:
        folder = f"{place}/pictures"
        Path(folder).mkdir()
        for i, (yaw, pitch) in enumerate(zip(yaws, pitches, strict=True)):
            lean = 0.6 * np.cos(i), 0.6 * np.sin(i), 0.3 * i
            om.write_image(f"{folder}/{i}.png", render([held(yaw, pitch, lean, 0.55)], noise=12).image)
        camera, drawing = Path(place, "camera.json"), Path(place, "next.png")
        calibrate([folder], model="mei", output=camera, quiet=True)
        propose([folder], camera=camera, count=3, draw=drawing, quiet=True)
        drawn = om.read_image(drawing)
    return shrunk(drawn, round(0.6 * len(drawn)))


def shoot(setup: Setup, *boards: BoardInScene) -> np.ndarray:
    """Take a picture with many rays and little noise."""
    return setup.renderer(samples=3)(boards, noise=0.6).image


def held(yaw: float, pitch: float, turn: tuple[float, float, float], distance: float) -> BoardInScene:
    """Hold the board in a direction (degrees), turned from facing the camera by a rotation vector."""
    facing = om.look(yaw, pitch).T
    rotation = facing @ exp(turn)
    return BoardInScene(BOARD, om.Pose(rotation, facing[:, 2] * distance - rotation @ BOARD.points.mean(0)))


def shrunk(image: np.ndarray, height: int) -> np.ndarray:
    """Shrink a picture to a height."""
    import cv2

    return cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height), interpolation=cv2.INTER_AREA)


def beside(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Join two pictures side by side."""
    height = min(len(left), len(right))
    return np.hstack([left[:height], np.zeros((height, GAP, 3), np.uint8), right[:height]])


def below(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    """Join two pictures one above the other."""
    return np.vstack([top, np.zeros((GAP, top.shape[1], 3), np.uint8), bottom])


if __name__ == "__main__":
    main()

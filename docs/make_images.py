"""Draws the images of the README and the documentation, from rendered scenes only: the same at every run."""

import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.geometry.rotation import exp
from omnisight.simulation import DEMO_BOARD, BoardInScene, Renderer, CameraSetup, GroundTruth, fisheye_setup, mirror_setup, scene_named

ASSETS = Path(__file__).parent / "assets"
GAP = 10


def main() -> None:
    """Draw all images."""
    ASSETS.mkdir(exist_ok=True)
    om.write_image(ASSETS / "hero.jpg", hero())
    om.write_image(ASSETS / "mirror.jpg", mirror())
    om.write_image(ASSETS / "next.jpg", next_picture())
    write_small(ASSETS / "simulate.jpg", rendered(), 72)


def hero() -> np.ndarray:
    """A fisheye image beside views of it: the board laid flat, the window, and half of the room around."""
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
    """The image of a mirror, and all that is around it on a cylinder."""
    setup = mirror_setup(1440)
    picture = shoot(setup)
    around = om.cylinder(1240, elevation=(-55, 18))
    unrolled = om.remap(picture, setup.camera, around, om.look(up="back"), interpolation="bicubic")
    u, v = round(setup.camera.model.to_dict()["cx"]), round(setup.camera.model.to_dict()["cy"])
    half = 536
    return beside(shrunk(picture[max(v - half, 0) : v + half, u - half : u + half], unrolled.shape[0]), unrolled)


def next_picture() -> np.ndarray:
    """Where to hold the board next, after seven images with it on the right."""
    from omnisight.cli.calibrate import calibrate
    from omnisight.cli.next import next as propose

    setup = fisheye_setup(960)
    render = setup.renderer(samples=2)
    yaws, pitches = (8, 25, 40, 55, 30, 15, 45), (5, -25, 10, -5, 30, -10, -30)
    with tempfile.TemporaryDirectory() as place:
        folder = f"{place}/images"
        Path(folder).mkdir()
        for i, (yaw, pitch) in enumerate(zip(yaws, pitches, strict=True)):
            lean = 0.6 * np.cos(i), 0.6 * np.sin(i), 0.3 * i
            om.write_image(f"{folder}/{i}.png", render([held(yaw, pitch, lean, 0.55)], noise=12).image)
        camera, drawing = Path(place, "camera.json"), Path(place, "next.png")
        calibrate([folder], model="mei", output=camera, quiet=True)
        propose([folder], camera=camera, count=3, draw=drawing, quiet=True)
        drawn = om.read_image(drawing)
    return shrunk(drawn, round(0.6 * len(drawn)))


def rendered() -> np.ndarray:
    """Show the room and the street through a fisheye, a mirror camera and all around, and the truth of two images."""
    fisheye, mirror = fisheye_setup(960), mirror_setup(960)
    rows = []
    truths = []
    for name, place in (("room", fisheye.world_from_cam), ("street", om.Pose())):
        scene = scene_named(name)
        lens = Renderer(fisheye.camera, place, scene, theta=fisheye.theta, samples=3)
        bowl = Renderer(mirror.camera, om.Pose(om.look(up="back")), scene, theta=mirror.theta, samples=3)
        around = Renderer(om.sphere(1104), place, scene, samples=3, vignette=0)
        discs = beside(disc(lens(noise=0.6).image), disc(bowl(noise=0.6).image))
        rows.append(beside(discs, around(noise=0.6).image))
        truths.append((lens if name == "street" else bowl).truth())
    room, street = truths
    figures = [disc(figure) for figure in (depths(street), normals(street), instances(street), instances(room))]
    rows.append(beside(beside(figures[0], figures[1]), beside(figures[2], figures[3])))
    width = min(row.shape[1] for row in rows)
    whole = below(below(*(row[:, :width] for row in rows[:2])), rows[2][:, :width])
    return shrunk(whole, round(1600 * whole.shape[0] / width))


def disc(image: np.ndarray) -> np.ndarray:
    """Cut the middle of an image 4:3 to a square."""
    side = image.shape[0]
    left = (image.shape[1] - side) // 2
    return shrunk(image[:, left : left + side], 552)


def depths(truth: GroundTruth) -> np.ndarray:
    """Show distance: the nearer the brighter."""
    with np.errstate(invalid="ignore"):
        near = np.clip(2.0 / truth.depth, 0, 1) ** 0.6
    return np.repeat(np.nan_to_num(255 * near).astype(np.uint8)[..., None], 3, -1)


def normals(truth: GroundTruth) -> np.ndarray:
    """Show normals as colours."""
    return np.nan_to_num(127.5 * (truth.normals + 1)).astype(np.uint8)


def instances(truth: GroundTruth) -> np.ndarray:
    """Show each thing in a colour of its own."""
    tones = np.random.default_rng(2).integers(40, 255, (truth.instances.max() + 1, 3)).astype(np.uint8)
    tones[0] = 0
    return tones[truth.instances]


def write_small(path: Path, image: np.ndarray, quality: int) -> None:
    """Write a JPEG of a quality."""
    import cv2

    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])


def shoot(setup: CameraSetup, *boards: BoardInScene) -> np.ndarray:
    """Take an image with many rays and little noise."""
    return setup.renderer(samples=3)(boards, noise=0.6).image


def held(yaw: float, pitch: float, turn: tuple[float, float, float], distance: float) -> BoardInScene:
    """Hold the board in a direction (degrees), turned from facing the camera by a rotation vector."""
    facing = om.look(yaw, pitch).T
    rotation = facing @ exp(turn)
    return BoardInScene(DEMO_BOARD, om.Pose(rotation, facing[:, 2] * distance - rotation @ DEMO_BOARD.points.mean(0)))


def shrunk(image: np.ndarray, height: int) -> np.ndarray:
    """Shrink an image to a height."""
    import cv2

    return cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height), interpolation=cv2.INTER_AREA)


def beside(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Join two images side by side."""
    height = min(len(left), len(right))
    return np.hstack([left[:height], np.zeros((height, GAP, 3), np.uint8), right[:height]])


def below(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    """Join two images one above the other."""
    return np.vstack([top, np.zeros((GAP, top.shape[1], 3), np.uint8), bottom])


if __name__ == "__main__":
    main()

"""Render the images of the README and the documentation; every run gives the same images."""

import dataclasses
import shutil
import tempfile
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.cli._capture_report import page_rows
from omnisight.cli._odometry_live import LiveFigures, advice
from omnisight.geometry.rotation import exp
from omnisight.pipeline.calibration.capture_session import CaptureSession, Seen
from omnisight.pipeline.demos.demo import demo
from omnisight.pipeline.odometry.frame_sequence import SequenceFrame
from omnisight.report.drawings.capture import draw_capture
from omnisight.report.drawings.next_view import draw_proposal
from omnisight.report.drawings.odometry import OdometryDrawing
from omnisight.report.drawings.stereo import draw_distances, draw_rectified
from omnisight.report.live.server import LivePage
from omnisight.simulation import (
    DEMO_BOARD,
    BoardInScene,
    CameraSetup,
    GroundTruth,
    Renderer,
    fisheye_setup,
    mirror_setup,
    scene_named,
)
from omnisight.targets.target_file import save_board

ASSETS = Path(__file__).parent / "assets"
GAP = 10


def main() -> None:
    """Write all images."""
    ASSETS.mkdir(exist_ok=True)
    om.write_image(ASSETS / "hero.jpg", hero())
    om.write_image(ASSETS / "mirror.jpg", mirror())
    om.write_image(ASSETS / "next.jpg", next_view())
    write_small(ASSETS / "simulate.jpg", rendered(), 72)
    write_small(ASSETS / "stereo.jpg", stereo(), 80)
    write_small(ASSETS / "report.jpg", report(), 82)
    write_small(ASSETS / "capture.jpg", capture_page(), 82)
    write_small(ASSETS / "odometry.jpg", odometry_page(), 82)


def hero() -> np.ndarray:
    """Return a fisheye image beside views of it: the board, the window, and half of the room."""
    setup = fisheye_setup(1440)
    image = render(setup, place_board(yaw=-37, pitch=-20, rotation=(0.25, 0.45, -0.16), distance=0.8))

    def view(target: om.Camera, yaw: float = 0, pitch: float = 0) -> np.ndarray:
        return om.remap(image, setup.camera, target, om.look(yaw, pitch), interpolation="bicubic")

    top = beside(view(om.perspective((470, 300), 70), -33, -10), view(om.perspective((470, 300), 66), 42, 2))
    wide = view(om.cylinder(top.shape[1], elevation=(-32, 28), azimuth=(-92, 92)))
    views = below(top, wide)
    whole = om.remap(image, setup.camera, om.fisheye(len(views), 191), interpolation="bicubic")
    return beside(whole, views)


def mirror() -> np.ndarray:
    """Return a mirror image beside the cylinder computed from it."""
    setup = mirror_setup(1440)
    image = render(setup)
    around = om.cylinder(1240, elevation=(-55, 18))
    unrolled = om.remap(image, setup.camera, around, om.look(up="back"), interpolation="bicubic")
    u, v = round(setup.camera.model.to_dict()["cx"]), round(setup.camera.model.to_dict()["cy"])
    half = 536
    return beside(shrink(image[max(v - half, 0) : v + half, u - half : u + half], unrolled.shape[0]), unrolled)


def next_view() -> np.ndarray:
    """Return the drawing of proposed board placements after seven images with the board on the right."""
    setup = fisheye_setup(960)
    renderer = setup.renderer(samples=2)
    yaws, pitches = (8, 25, 40, 55, 30, 15, 45), (5, -25, 10, -5, 30, -10, -30)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{i}.png" for i in range(len(yaws))]
        for i, (path, yaw, pitch) in enumerate(zip(paths, yaws, pitches, strict=True)):
            rotation = 0.6 * np.cos(i), 0.6 * np.sin(i), 0.3 * i
            om.write_image(path, renderer([place_board(yaw, pitch, rotation, 0.55)], noise=12).image)
        calibration = om.calibrate(paths, om.CalibrateOptions(square="40mm", model="mei"))
        proposal = om.next_view(calibration.observations, calibration.camera)
        detections = calibration.observations.detections
        assert detections is not None
        draw_proposal(proposal, detections, file := Path(folder) / "next.png")
        drawing = om.read_image(file)
    return shrink(drawing, round(0.6 * len(drawing)))


def rendered() -> np.ndarray:
    """Return the room and the street through a fisheye, a mirror camera and as a sphere, and ground truth images."""
    fisheye, mirror = fisheye_setup(960), mirror_setup(960)
    rows = []
    truths = []
    for name, pose in (("room", fisheye.world_from_cam), ("street", om.Pose())):
        scene = scene_named(name)
        fisheye_view = Renderer(fisheye.camera, pose, scene, theta=fisheye.theta, samples=3)
        mirror_view = Renderer(mirror.camera, om.Pose(om.look(up="back")), scene, theta=mirror.theta, samples=3)
        sphere_view = Renderer(om.sphere(1104), pose, scene, samples=3, vignette=0)
        discs = beside(disc(fisheye_view(noise=0.6).image), disc(mirror_view(noise=0.6).image))
        rows.append(beside(discs, sphere_view(noise=0.6).image))
        truths.append((fisheye_view if name == "street" else mirror_view).truth())
    room, street = truths
    discs = [disc(image) for image in (depths(street), normals(street), instances(street), instances(room))]
    rows.append(beside(beside(discs[0], discs[1]), beside(discs[2], discs[3])))
    width = min(row.shape[1] for row in rows)
    result = below(below(*(row[:, :width] for row in rows[:2])), rows[2][:, :width])
    return shrink(result, round(1600 * result.shape[0] / width))


def stereo() -> np.ndarray:
    """Return a rectified pair of fisheye images beside the distances in the left image."""
    setup, right_from_left = fisheye_setup(960), om.Pose(exp([0.0, 0.03, 0.02]), np.array([-0.12, 0.0, 0.0]))
    poses = setup.world_from_cam, setup.world_from_cam @ right_from_left.inverse()
    left, right = (Renderer(setup.camera, pose, theta=setup.theta)().image for pose in poses)
    rig = om.Rig.from_sensors({"left": (setup.camera, om.Pose()), "right": (setup.camera, right_from_left)})
    result = om.stereo(left, right, rig)
    return beside(shrink(draw_rectified(result), 620), shrink(draw_distances(result), 620))


def report() -> np.ndarray:
    """Return a screenshot of the report of the fisheye of the demo: its head, and the images with residuals."""
    with tempfile.TemporaryDirectory() as folder:
        fisheye, _ = demo(Path(folder))
        page = Path(folder) / "report.html"
        om.write_report(fisheye.calibration, page)
        return screenshot(page.as_uri(), {"width": 1180, "height": 1240}, 1.25)


def capture_page() -> np.ndarray:
    """Return a screenshot of the page of `omnisight capture` after five images of a fisheye."""
    setup = fisheye_setup(960)
    renderer, shown = setup.renderer(samples=2), list[tuple[CaptureSession, Seen]]()
    with tempfile.TemporaryDirectory() as folder, LivePage("Capture of camera 0") as page:
        options = om.CaptureOptions(target=Path(folder) / "board.json", images=5, coverage=1)
        save_board(DEMO_BOARD, Path(folder) / "board.json")
        for k, (yaw, pitch) in enumerate(((-55, 20), (55, 20), (-50, -25), (40, -35), (5, 40))):
            board = place_board(yaw, pitch, (0.5 * np.cos(k), 0.5 * np.sin(k), 0.3 * k), 0.5)
            om.write_image(Path(folder) / f"{k}.png", renderer([board], noise=5).image)
        om.capture(folder, Path(folder) / "images", options, lambda *arguments: shown.append(arguments))
        session, seen = shown[-1]
        page.show(draw_capture(session, seen), "stored", page_rows(session, options))
        return screenshot(page.url, {"width": 1100, "height": 1000}, 1.0)


def odometry_page() -> np.ndarray:
    """Return a screenshot of the page of `omnisight odometry --live` after most of a loop through the room."""
    setup = fisheye_setup(640)
    camera = dataclasses.replace(setup.camera, theta_max=setup.theta[1])
    tracking, drawing, figures = om.Odometry(camera), OdometryDrawing(), LiveFigures()
    with tempfile.TemporaryDirectory() as folder, LivePage("Odometry of camera 0") as page:
        om.simulate(om.SimulateOptions("room", camera, Path(folder) / "room", frames=60, fps=10, rays=1, jpeg=95))
        files = sorted((Path(folder) / "room" / "images").iterdir())[:50]
        for index, file in enumerate(files):
            frame = SequenceFrame(index, index / 10, (om.read_image(file),))
            tracking.add(frame.images, frame.seconds)
            drawing.add(tracking)
            figures.add(tracking)
        rows = {name: text for name, text in figures.rows(tracking, frame).items() if name != "Rate"}
        page.show(drawing.draw(tracking, frame.images[0]), advice(tracking, frame), rows)
        return screenshot(page.url, {"width": 1300, "height": 800}, 1.0)


def screenshot(address: str, viewport: dict[str, int], scale: float) -> np.ndarray:
    """Return a screenshot of a page."""
    import cv2
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        window = browser.new_page(viewport=viewport, device_scale_factor=scale)
        window.goto(address)
        window.wait_for_timeout(1000)
        data = window.screenshot()
        browser.close()
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)


def disc(image: np.ndarray) -> np.ndarray:
    """Return the central square of an image of 4:3."""
    side = image.shape[0]
    left = (image.shape[1] - side) // 2
    return shrink(image[:, left : left + side], 552)


def depths(truth: GroundTruth) -> np.ndarray:
    """Return an image of the depth, brighter where nearer."""
    with np.errstate(invalid="ignore"):
        near = np.clip(2.0 / truth.depth, 0, 1) ** 0.6
    return np.repeat(np.nan_to_num(255 * near).astype(np.uint8)[..., None], 3, -1)


def normals(truth: GroundTruth) -> np.ndarray:
    """Return an image of the normals as colours."""
    return np.nan_to_num(127.5 * (truth.normals + 1)).astype(np.uint8)


def instances(truth: GroundTruth) -> np.ndarray:
    """Return an image with one colour per instance."""
    colours = np.random.default_rng(2).integers(40, 255, (truth.instances.max() + 1, 3)).astype(np.uint8)
    colours[0] = 0
    return colours[truth.instances]


def write_small(path: Path, image: np.ndarray, quality: int) -> None:
    """Write a JPEG of the given quality."""
    import cv2

    cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])


def render(setup: CameraSetup, *boards: BoardInScene) -> np.ndarray:
    """Return an image with many rays per pixel and little noise."""
    return setup.renderer(samples=3)(boards, noise=0.6).image


def place_board(yaw: float, pitch: float, rotation: tuple[float, float, float], distance: float) -> BoardInScene:
    """Return a board in a direction (degrees), rotated by a rotation vector from the pose that faces the camera."""
    facing = om.look(yaw, pitch).T
    board_rotation = facing @ exp(rotation)
    centre = facing[:, 2] * distance
    return BoardInScene(DEMO_BOARD, om.Pose(board_rotation, centre - board_rotation @ DEMO_BOARD.points.mean(0)))


def shrink(image: np.ndarray, height: int) -> np.ndarray:
    """Return the image scaled down to a height."""
    import cv2

    return cv2.resize(image, (round(image.shape[1] * height / image.shape[0]), height), interpolation=cv2.INTER_AREA)


def beside(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return two images side by side."""
    height = min(len(left), len(right))
    return np.hstack([left[:height], np.zeros((height, GAP, 3), np.uint8), right[:height]])


def below(top: np.ndarray, bottom: np.ndarray) -> np.ndarray:
    """Return two images one above the other."""
    return np.vstack([top, np.zeros((GAP, top.shape[1], 3), np.uint8), bottom])


if __name__ == "__main__":
    main()

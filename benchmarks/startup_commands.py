"""One small run of each command, and the files that these runs need."""

import shutil
from pathlib import Path

import numpy as np

import omnisight as om
from omnisight.formats import save
from omnisight.geometry.pose import Pose
from omnisight.images import write_image
from omnisight.models.equidistant import Equidistant
from omnisight.pipeline.localization.visual_map import build_map, write_map
from omnisight.pipeline.simulation.simulate import simulate
from omnisight.pipeline.simulation.simulate_options import SimulateOptions
from omnisight.rig import Rig
from omnisight.simulation import BoardInScene, Renderer, fisheye_setup
from omnisight.simulation.example_rigs import back_to_back, surround_car

BOARD_IMAGES, FRAMES = 8, 8
SIZE_2_MP = (1664, 1216)

# Each command on the files of `write_inputs`; OUT is a new folder. A camera is connected to no benchmark machine, so
# capture and odometry read files.
COMMANDS = {
    "inspect": "inspect camera.json",
    "view": "view image.jpg --camera large.json --yaw 20 -o OUT/view.jpg",
    "detect": "detect boards/1.jpg --pattern 8x5 -o OUT/drawn",
    "calibrate": "calibrate boards --pattern 8x5 --square 40mm -o OUT/camera.json",
    "evaluate": "evaluate camera.json boards --pattern 8x5 --square 40mm",
    "next": "next boards --camera camera.json --pattern 8x5",
    "capture": "capture boards --pattern 8x5 -o OUT/captured",
    "calibrate-lines": "calibrate-lines walk/images/000000.jpg --model equidistant -o OUT/camera.json",
    "calibrate-rig": "calibrate-rig left=boards right=boards_right --pattern 8x5 --square 40mm -o OUT/rig.json",
    "compare": "compare camera.json other.json",
    "convert": "convert camera.json --to kalibr -o OUT/kalibr.yaml",
    "export": "export large.json --to opencv-map -o OUT/map",
    "target": "target checkerboard 9x6 --square 24mm -o OUT/board.pdf",
    "design": "design mirror --up 20 --down 60",
    "simulate": "simulate room --camera camera.json --frames 1 --rays 1 -o OUT/simulated",
    "stitch": "stitch head/front/images/000000.jpg head/back/images/000000.jpg --rig head.json -o OUT/sphere.jpg",
    "birdseye": "birdseye front.jpg right.jpg back.jpg left.jpg --rig car.json -o OUT/ground.jpg",
    "stereo": "stereo boards/1.jpg boards_right/1.jpg --rig pair.json",
    "epipolar": "epipolar walk/images/000000.jpg walk/images/000001.jpg --camera walk.json",
    "doctor": "doctor walk/images --camera walk.json",
    "odometry": "odometry walk/images --camera walk.json -o OUT/trajectory.tum",
    "reconstruct": "reconstruct walk/images --camera walk.json -o OUT/model",
    "map": "map walk/images --camera walk.json -o OUT/map",
    "localize": "localize walk/images/000003.jpg --map known_map --camera walk.json",
    "compass": "compass around/images/000001.jpg --reference around/images",
    "demo": "demo OUT/demo",
}


def write_inputs(folder: Path) -> None:
    """Render images of a board, of a walk and of rigs, and write their cameras."""
    setup = fisheye_setup()
    right_from_left = Pose(translation=np.array((-0.1, 0.0, 0.0)))
    right = Renderer(setup.camera, setup.world_from_cam @ right_from_left.inverse(), theta=setup.theta, samples=1)
    left = setup.renderer(samples=1)
    for name in ("boards", "boards_right"):
        (folder / name).mkdir()
    for k, placed in enumerate(setup.boards(BOARD_IMAGES)):
        write_image(folder / "boards" / f"{k}.jpg", left([placed], np.random.default_rng(k)).image)
        moved = BoardInScene(placed.board, right_from_left @ placed.cam_from_board)
        write_image(folder / "boards_right" / f"{k}.jpg", right([moved], np.random.default_rng(k)).image)
    rig = Rig((setup.camera, setup.camera), (Pose(), right_from_left), ("left", "right"))
    width, height = SIZE_2_MP
    large = om.Camera(Equidistant(400.0, 400.0, (width - 1) / 2, (height - 1) / 2), SIZE_2_MP, theta_max=1.5)
    walk = om.fisheye(640, 180)
    for name, camera in (("camera", setup.camera), ("other", setup.camera), ("large", large), ("walk", walk)):
        save(camera, folder / f"{name}.json")
    write_image(folder / "image.jpg", Renderer(large, setup.world_from_cam, samples=1)().image)
    simulate(SimulateOptions("room", walk, folder / "walk", frames=FRAMES, fps=8.0, rays=1, jpeg=90))
    simulate(SimulateOptions("room", om.sphere(512), folder / "around", frames=3, rays=1, jpeg=90))
    for name, head in (("head", back_to_back(480)), ("car", surround_car(480)), ("pair", rig)):
        save(head, folder / f"{name}.json")
        if name != "pair":
            simulate(SimulateOptions("room", head, folder / name, frames=1, rays=1, jpeg=90))
    for name in surround_car().names:
        shutil.copy(folder / "car" / name / "images" / "000000.jpg", folder / f"{name}.jpg")
    made, _ = build_map(folder / "walk" / "images", walk)
    assert made is not None
    write_map(folder / "known_map", made)

"""Images of scenes through any camera, by ray casting, with ground truth."""

from omnisight.simulation.board import BoardInScene, board_solid
from omnisight.simulation.example_cameras import DEMO_BOARD, CameraSetup, fisheye_setup, mirror_setup
from omnisight.simulation.board_poses import board_poses
from omnisight.simulation.render import RenderedImage, Renderer, GroundTruth, dense_correspondences, render
from omnisight.simulation.scene import Hits, Scene
from omnisight.simulation.scenes import scene_named, scene_names
from omnisight.simulation.sensor import develop
from omnisight.simulation.solids import Solid, ellipsoid, box, rectangle, roof, cylinder
from omnisight.simulation.texture import Texture
from omnisight.simulation.trajectory import Trajectory, preset_trajectory, read_trajectory, write_trajectory

__all__ = [
    "DEMO_BOARD",
    "BoardInScene",
    "Hits",
    "RenderedImage",
    "Renderer",
    "Scene",
    "CameraSetup",
    "Solid",
    "Texture",
    "Trajectory",
    "GroundTruth",
    "ellipsoid",
    "board_poses",
    "box",
    "preset_trajectory",
    "develop",
    "fisheye_setup",
    "dense_correspondences",
    "mirror_setup",
    "read_trajectory",
    "rectangle",
    "render",
    "roof",
    "scene_named",
    "scene_names",
    "board_solid",
    "cylinder",
    "write_trajectory",
]

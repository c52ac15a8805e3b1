"""Pictures of scenes through any camera, by ray casting, with ground truth."""

from omnisight.simulate.board import BoardInScene, standing
from omnisight.simulate.examples import BOARD, Setup, fisheye_setup, mirror_setup
from omnisight.simulate.poses import board_poses
from omnisight.simulate.render import Picture, Renderer, Truth, matches, render
from omnisight.simulate.scene import Hits, Scene
from omnisight.simulate.scenes import scene_named, scene_names
from omnisight.simulate.sensor import develop
from omnisight.simulate.solids import Solid, ball, box, rectangle, roof, tube
from omnisight.simulate.texture import Texture
from omnisight.simulate.trajectory import Trajectory, built_in, read_trajectory, write_trajectory

__all__ = [
    "BOARD",
    "BoardInScene",
    "Hits",
    "Picture",
    "Renderer",
    "Scene",
    "Setup",
    "Solid",
    "Texture",
    "Trajectory",
    "Truth",
    "ball",
    "board_poses",
    "box",
    "built_in",
    "develop",
    "fisheye_setup",
    "matches",
    "mirror_setup",
    "read_trajectory",
    "rectangle",
    "render",
    "roof",
    "scene_named",
    "scene_names",
    "standing",
    "tube",
    "write_trajectory",
]

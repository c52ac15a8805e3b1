"""Pictures of a furnished room through any camera, with ground truth."""

from omnisight.simulate.board import BoardInScene
from omnisight.simulate.examples import BOARD, Setup, fisheye_setup, mirror_setup
from omnisight.simulate.poses import board_poses
from omnisight.simulate.render import Picture, Renderer, render
from omnisight.simulate.room import Room

__all__ = [
    "BOARD",
    "BoardInScene",
    "Picture",
    "Renderer",
    "Room",
    "Setup",
    "board_poses",
    "fisheye_setup",
    "mirror_setup",
    "render",
]

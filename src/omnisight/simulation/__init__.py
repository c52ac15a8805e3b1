"""Rendering of scenes through any camera by ray casting, with ground truth."""

from omnisight.motion_sensor_options import GnssNoise, ImuNoise, MotionSensors, OdometryNoise
from omnisight.simulation.board import BoardInScene, board_solid
from omnisight.simulation.board_poses import board_poses
from omnisight.simulation.example_cameras import DEMO_BOARD, CameraSetup, fisheye_setup, mirror_setup
from omnisight.simulation.motion_sensors import measure_gnss, measure_imu, measure_odometry
from omnisight.simulation.preset_motion import DRIVE, WALK, Pace, Route, preset_trajectory
from omnisight.simulation.render import Renderer, dense_correspondences, render
from omnisight.simulation.rendered import GroundTruth, RenderedImage
from omnisight.simulation.scene import Hits, Scene
from omnisight.simulation.scenes import scene_named, scene_names
from omnisight.simulation.sensor import develop
from omnisight.simulation.solids import Solid, box, cylinder, ellipsoid, rectangle, roof
from omnisight.simulation.spline_trajectory import Kinematics, SplineTrajectory
from omnisight.simulation.texture import Texture
from omnisight.simulation.trajectory import Motion, Trajectory, read_trajectory, write_trajectory

__all__ = [
    "DEMO_BOARD",
    "DRIVE",
    "WALK",
    "BoardInScene",
    "CameraSetup",
    "GnssNoise",
    "GroundTruth",
    "Hits",
    "ImuNoise",
    "Kinematics",
    "Motion",
    "MotionSensors",
    "OdometryNoise",
    "Pace",
    "RenderedImage",
    "Renderer",
    "Route",
    "Scene",
    "Solid",
    "SplineTrajectory",
    "Texture",
    "Trajectory",
    "board_poses",
    "board_solid",
    "box",
    "cylinder",
    "dense_correspondences",
    "develop",
    "ellipsoid",
    "fisheye_setup",
    "measure_gnss",
    "measure_imu",
    "measure_odometry",
    "mirror_setup",
    "preset_trajectory",
    "read_trajectory",
    "rectangle",
    "render",
    "roof",
    "scene_named",
    "scene_names",
    "write_trajectory",
]

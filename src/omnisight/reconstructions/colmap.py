"""COLMAP's text files: cameras.txt, images.txt, points3D.txt, and rigs.txt and frames.txt of COLMAP 4."""

from collections.abc import Iterable

from omnisight.reconstructions._colmap_model import ColmapModel, colmap_model
from omnisight.reconstructions._protocol import ExportOptions, OutputFile
from omnisight.sfm.reconstruction import Reconstruction

TITLE = "COLMAP text"
CONVENTION = (
    "cam_from_world, quaternion w x y z; the centre of the top-left pixel is (0.5, 0.5); the frame of a rig is that of"
    " its first camera"
)
POSE = "QW, QX, QY, QZ, TX, TY, TZ"
HEADERS = {
    "cameras": ("CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",),
    "rigs": (
        "RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID,"
        f" SENSORS[] as (SENSOR_TYPE, SENSOR_ID, HAS_POSE, [{POSE}])",
    ),
    "frames": (
        f"FRAME_ID, RIG_ID, RIG_FROM_WORLD[{POSE}], NUM_DATA_IDS, DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)",
    ),
    "images": (f"IMAGE_ID, {POSE}, CAMERA_ID, NAME", "POINTS2D[] as (X, Y, POINT3D_ID)"),
    "points3D": ("POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",),
}
FILES = tuple(f"{name}.txt" for name in HEADERS)


def files(reconstruction: Reconstruction, options: ExportOptions) -> list[OutputFile]:
    """Return the five files."""
    if spaced := [name for name in reconstruction.names if any(map(str.isspace, name))]:
        raise ValueError(
            f"the image {spaced[0]!r} has a space in its name, where COLMAP's text files end it: export with --to"
            " colmap_binary, or rename the image"
        )
    model = colmap_model(reconstruction)
    tables = {
        "cameras": [
            f"{number} {camera.model} {camera.size[0]} {camera.size[1]} {_join(camera.params)}"
            for number, camera in enumerate(model.cameras, 1)
        ],
        "rigs": _rigs(model),
        "frames": [
            f"{number} {frame.rig} {_join(frame.pose)} {len(frame.images)} "
            + " ".join(f"CAMERA {camera} {image}" for camera, image in frame.images)
            for number, frame in enumerate(model.frames, 1)
        ],
        "images": _images(model),
        "points3D": _points(model),
    }
    return [
        (
            f"{name}.txt",
            "\n".join((*(f"# {line}" for line in HEADERS[name]), *lines, "")).encode("utf-8", "surrogateescape"),
        )
        for name, lines in tables.items()
    ]


def _rigs(model: ColmapModel) -> list[str]:
    """Return the lines of rigs.txt."""
    return [
        " ".join(
            [
                f"{number} {len(rig.sensors) + 1} CAMERA {rig.reference}",
                *(f"CAMERA {sensor} 1 {_join(pose)}" for sensor, pose in rig.sensors.items()),
            ]
        )
        for number, rig in enumerate(model.rigs, 1)
    ]


def _images(model: ColmapModel) -> list[str]:
    """Return the lines of images.txt; the second line of an image without observations is empty."""
    lines: list[str] = []
    for number, image in enumerate(model.images, 1):
        lines.append(f"{number} {_join(image.pose)} {image.camera} {image.name}")
        pairs = zip(image.pixels.tolist(), image.points.tolist(), strict=True)
        lines.append(" ".join(f"{x!r} {y!r} {point}" for (x, y), point in pairs))
    return lines


def _points(model: ColmapModel) -> list[str]:
    """Return the lines of points3D.txt."""
    columns = zip(model.position.tolist(), model.color.tolist(), model.error.tolist(), model.tracks, strict=True)
    return [
        f"{number} {_join(position)} {_join(color)} {error!r} {_join(track.ravel().tolist())}"
        for number, (position, color, error, track) in enumerate(columns, 1)
    ]


def _join(values: Iterable[float]) -> str:
    return " ".join(map(repr, values))

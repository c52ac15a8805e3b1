"""Exports of a reconstruction: nerfstudio, glTF, and the command."""

import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omnisight import cli
from omnisight.formats.nerfstudio import parse
from omnisight.reconstructions import (
    ExportOptions,
    ReconstructionError,
    export_reconstruction,
    get_reconstruction_format,
    read_reconstruction,
    reconstruction_format_names,
    write_reconstruction,
)
from reconstructing import independent, single, two_fisheyes, without_points

NERFSTUDIO = ExportOptions("nerfstudio")


@pytest.mark.parametrize("make", [single, two_fisheyes, lambda: single("pinhole"), lambda: single("equidistant")])
def test_the_points_project_to_their_pixels_with_the_poses_of_nerfstudio(tmp_path, make):
    made = make()
    export_reconstruction(made, tmp_path, NERFSTUDIO)
    text = (tmp_path / "transforms.json").read_text()
    data = json.loads(text)
    assert [frame["file_path"] for frame in data["frames"]] == [f"images/{name}" for name in made.names]
    observations = made.observations
    for i, frame in enumerate(data["frames"]):
        (camera,) = parse(json.dumps({**data, **frame, "frames": []})).values()
        matrix = np.array(frame["transform_matrix"])
        chosen = observations.image == i
        points = made.points.position[observations.point[chosen]]
        opengl = (points - matrix[:3, 3]) @ matrix[:3, :3]
        pixels, valid = camera.project(opengl * [1, -1, -1])
        assert valid.all()
        assert pixels - observations.pixels[chosen] == pytest.approx(observations.residuals[chosen], abs=1e-6)
    header = (tmp_path / data["ply_file_path"]).read_bytes()[:200]
    assert f"element vertex {len(made.points)}\n".encode() in header


def test_two_kinds_of_cameras_are_refused_by_nerfstudio(tmp_path):
    with pytest.raises(ReconstructionError, match="EQUIRECTANGULAR and PINHOLE: export --to splat"):
        export_reconstruction(independent(), tmp_path, NERFSTUDIO)
    assert not list(tmp_path.iterdir())


def test_gltf_has_the_points_and_a_node_per_image(tmp_path):
    made = two_fisheyes()
    export_reconstruction(made, tmp_path, ExportOptions("glb"))
    data = (tmp_path / "model.glb").read_bytes()
    magic, version, length, text_length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + text_length])
    (binary_length, kind), binary = struct.unpack_from("<I4s", data, 20 + text_length), data[28 + text_length :]
    assert (binary_length, kind) == (len(binary), b"BIN\0")
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= len(binary)
    nodes = {node["name"]: node for node in document["nodes"]}
    assert set(nodes) == {"points", "reconstruction", *made.names}
    accessor = document["accessors"][
        document["meshes"][nodes["points"]["mesh"]]["primitives"][0]["attributes"]["POSITION"]
    ]
    view = document["bufferViews"][accessor["bufferView"]]
    points = np.frombuffer(binary, "<f4", accessor["count"] * 3, view["byteOffset"]).reshape(-1, 3)
    assert points.min(axis=0).tolist() == accessor["min"]
    assert points + nodes["points"]["translation"] == pytest.approx(made.points.position, abs=1e-5)
    for i, name in enumerate(made.names):
        pose = made.world_from_cam(i)
        assert nodes[name]["translation"] == pytest.approx(pose.translation.tolist())
        assert Rotation.from_quat(nodes[name]["rotation"]).as_matrix() == pytest.approx(pose.rotation, abs=1e-12)


def test_gltf_turns_the_upper_sides_of_the_images_to_y(tmp_path):
    made = single()
    export_reconstruction(made, tmp_path, ExportOptions("glb"))
    data = (tmp_path / "model.glb").read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    root = document["nodes"][document["scenes"][0]["nodes"][0]]
    rotation = Rotation.from_quat(root["rotation"]).as_matrix()
    ups = np.array([rotation @ made.world_from_cam(i).rotation @ [0, -1, 0] for i in range(len(made))])
    assert ups.mean(axis=0) / np.linalg.norm(ups.mean(axis=0)) == pytest.approx([0, 1, 0], abs=1e-9)
    assert len(root["children"]) == len(made) + 1


def test_a_reconstruction_without_points_is_exported(tmp_path):
    made = without_points(single())
    write_reconstruction(tmp_path / "model", made)
    again = read_reconstruction(tmp_path / "model")
    assert len(again.points) == len(again.observations) == 0
    for name in ("colmap", "colmap_binary", "glb", "native", "nerfstudio", "ply", "poses_csv"):
        assert export_reconstruction(again, tmp_path / name, ExportOptions(name)), name


def test_every_format_has_a_title_and_a_convention():
    names = reconstruction_format_names()
    assert len(names) > 6
    for name in names:
        assert get_reconstruction_format(name).TITLE
        assert get_reconstruction_format(name).CONVENTION


def run(*arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main(["export", *map(str, arguments)])
    return caught.value.code


def test_the_command_writes_the_files_and_prints_where(tmp_path, capsys):
    write_reconstruction(tmp_path / "model", single())
    assert run(tmp_path / "model", "--to", "colmap", "-o", tmp_path / "out") == 0
    assert f"written     {tmp_path / 'out'}; files: 5" in capsys.readouterr().out
    assert (tmp_path / "out" / "points3D.txt").exists()
    assert run(tmp_path / "model", "--to", "glb", "-o", tmp_path / "out", "--json") == 0
    assert json.loads(capsys.readouterr().out)["files"] == [str(tmp_path / "out" / "model.glb")]


def test_the_command_writes_a_viewer_to_a_new_folder(tmp_path, capsys):
    write_reconstruction(tmp_path / "model", single())
    assert run(tmp_path / "model", "--to", "viewer", "-o", tmp_path / "new" / "out") == 0
    assert "HTML viewer" in capsys.readouterr().out
    assert "<canvas" in (tmp_path / "new" / "out" / "viewer.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("model", "--to", "obj"),
            "unknown format 'obj'; there are: ffmpeg",
        ),
        (("none", "--to", "ply"), "no such folder"),
        (("none", "--to", "viewer", "--images", "photos"), "photos: no such folder"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(tmp_path, capsys, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    write_reconstruction("model", single())
    assert run(*arguments, "-o", "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

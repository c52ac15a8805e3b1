"""Files of corners, written by the tools they come from where those are at hand."""

import json

import cv2
import numpy as np
import pytest
import scipy.io

from lenses import BOARD, lens, observe_boards
from omnisight.corners import corner_format_names, get_corner_format, read_corners
from omnisight.formats import FormatError

SIZE = (960, 962)
STEP = 0.03
VIEWS = observe_boards(lens(180), 180, np.random.default_rng(3), count=4)
NAMES = [f"shot-{k}.png" for k in range(4)]


def structs(**fields):
    """Return an array of MATLAB structs."""
    made = np.empty((1, len(next(iter(fields.values())))), [(name, object) for name in fields])
    for name, values in fields.items():
        made[name][0] = [*values]
    return made


def babelcalib(folder):
    corners = structs(
        x=[pixels.T + 1 for _, pixels in VIEWS],
        cspond=[np.stack([np.arange(54) + 1, np.ones(54)]).astype(np.uint16) for _ in VIEWS],
    )
    boards = structs(X=[STEP * BOARD.points[:, :2].T], Rt=[np.eye(3, 4, dtype=np.uint8)])
    scipy.io.savemat(
        folder / "t.mat", {"corners": corners, "boards": boards, "imgsize": np.array(SIZE[::-1])}, do_compression=True
    )
    return [folder / "t.mat"], {}


def deltille(folder):
    points = "".join(f"-1,{i % 9},{i // 9},{3 * x:f},{3 * y:f},0.0\n" for i, (x, y, _) in enumerate(BOARD.points))
    (folder / "board.dsc").write_text(f"0,7,10,30.0\nt25h7,2.0\n{points}")
    for name, (_, pixels) in zip(NAMES, VIEWS, strict=True):
        rows = "".join(f"0,{i},1,{x!r},{y!r}\n" for i, (x, y) in enumerate(pixels.tolist()))
        head = f"filename: {name}\nwidth: {SIZE[0]}\nheight: {SIZE[1]}\nnum_corners: 54\nencoding: ascii\n"
        (folder / name).with_suffix(".orpc").write_text(head + rows)
    return sorted(folder.glob("*.orpc")), {}


def matlab(folder):
    seen = np.stack([pixels + 1 for _, pixels in VIEWS], -1)
    held = {"imagePoints": seen, "worldPoints": 30 * BOARD.points[:, :2], "imageSize": np.array(SIZE[::-1])}
    scipy.io.savemat(folder / "m.mat", held)
    return [folder / "m.mat"], {}


def mrcal(folder):
    rows = [f"{n} {x!r} {y!r} 0" for n, (_, p) in zip(NAMES, VIEWS, strict=True) for x, y in p.tolist()]
    text = "\n".join(["## produced by mrgingham", "# filename x y level", *rows[:54], "none.png - - -", *rows[54:]])
    (folder / "corners.vnl").write_text(text + "\n")
    return [folder / "corners.vnl"], {"board": BOARD, "size": SIZE}


def native(folder):
    images = [
        {"name": n, "size": SIZE, "boards": [{"ids": [*range(54)], "pixels": p.tolist()}]}
        for n, (_, p) in zip(NAMES, VIEWS, strict=True)
    ]
    data = {"format": "omnisight-corners", "target": BOARD.to_dict(), "images": images}
    (folder / "corners.json").write_text(json.dumps(data))
    return [folder / "corners.json"], {}


def numpy_arrays(folder):
    # A script's way: cv2.findChessboardCorners gives (N, 1, 2) of float32.
    seen = np.array([pixels[:, None] for _, pixels in VIEWS])
    np.savez(folder / "p.npz", imgpoints=seen, objpoints=[BOARD.points] * 4, image_size=SIZE, files=NAMES)
    return [folder / "p.npz"], {}


def ocamcalib(folder):
    held = {
        "Xt": 30 * BOARD.points[:, :1],
        "Yt": 30 * BOARD.points[:, 1:2],
        "Xp_abs": np.stack([p[:, 1:] + 1 for _, p in VIEWS] + [np.zeros((54, 1))], -1),
        "Yp_abs": np.stack([p[:, :1] + 1 for _, p in VIEWS] + [np.zeros((54, 1))], -1),
        "ima_proc": np.arange(4) + 1,
        "width": SIZE[0],
        "height": SIZE[1],
    }
    scipy.io.savemat(folder / "o.mat", held)
    return [folder / "o.mat"], {}


def opencv(folder, suffix=".yml"):
    file = folder / f"points{suffix}"
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for name, values in (("objectPoints", [BOARD.points] * 4), ("imagePoints", [p for _, p in VIEWS])):
        storage.startWriteStruct(name, cv2.FileNode_SEQ)
        for matrix in values:
            storage.write("", matrix.reshape(-1, 1, matrix.shape[1]))
        storage.endWriteStruct()
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.release()
    return [file], {}


WRITERS = {writer.__name__: writer for writer in (babelcalib, deltille, matlab, mrcal, native, numpy_arrays)}
WRITERS |= {"ocamcalib": ocamcalib, "opencv": opencv}


def same(detections):
    """Hold what was read to what was written."""
    assert detections.size == SIZE
    assert len(detections.found) == len(VIEWS)
    points = detections.board.points
    unit = 1.0 if detections.board.unit == "squares" else STEP
    for image, (whole, pixels) in zip(detections.found, VIEWS, strict=True):
        (seen,) = image.boards
        np.testing.assert_allclose(seen.pixels, pixels, atol=1e-9)
        apart = points[seen.ids] - points[seen.ids[:1]]
        np.testing.assert_allclose(apart, unit * (whole - whole[:1]), atol=1e-9)


def test_checkerboards_of_matlab_are_read_column_by_column(tmp_path):
    columns = np.arange(54).reshape(BOARD.rows, BOARD.columns).T.ravel()
    points = np.stack([pixels[columns] + 1 for _, pixels in VIEWS], -1)
    scipy.io.savemat(tmp_path / "m.mat", {"imagePoints": points, "imageSize": np.array(SIZE[::-1])})
    detections = read_corners([tmp_path / "m.mat"], board=BOARD, square=STEP)
    (seen,) = detections.found[0].boards
    steps = np.round(detections.board.points[seen.ids] / STEP).astype(int).tolist()
    placed = {tuple(step): pixel for step, pixel in zip(steps, seen.pixels, strict=True)}
    assert len(placed) == 54
    for (x, y, _), pixel in zip(BOARD.points, VIEWS[0][1], strict=True):
        np.testing.assert_allclose(placed[round(x), round(y), 0], pixel, atol=1e-9)


@pytest.mark.parametrize("name", corner_format_names())
def test_format_reads_corners_of_its_tool(name, tmp_path):
    files, options = WRITERS[name](tmp_path)
    detections = read_corners(files, **options)
    same(detections)
    assert detections.board.unit == ("m" if name == "deltille" else "squares")
    # Whatever unit a file has, or none, --square says how far neighbours are apart.
    metric = read_corners(files, square=STEP, **options)
    assert metric.board.unit == "m"
    same(metric)


@pytest.mark.parametrize("name", corner_format_names())
def test_format_is_documented_and_matches_only_its_files(name, tmp_path):
    chosen = get_corner_format(name)
    assert chosen.TITLE
    assert chosen.CONVENTION
    assert chosen.SUFFIX.startswith(".")
    for other, writer in WRITERS.items():
        folder = tmp_path / other
        folder.mkdir()
        (file, *_), _ = writer(folder)
        data = file.read_bytes()
        text = data.decode("latin-1" if file.suffix in (".mat", ".npz") else "utf-8")
        assert chosen.matches(text) is (other == name), other


@pytest.mark.parametrize("name", corner_format_names())
def test_truncated_corner_file_is_read_or_refused(name, tmp_path):
    (file, *rest), options = WRITERS[name](tmp_path)
    whole = file.read_bytes()
    refused = 0
    for part in np.linspace(0, 0.97, 14):
        file.write_bytes(whole[: int(part * len(whole))])
        # A text file that is cut between two images is still valid.
        try:
            read_corners([file, *rest], **options)
        except FormatError:
            refused += 1
    assert refused > 0


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_opencv_yaml_xml_and_json(suffix, tmp_path):
    same(read_corners(opencv(tmp_path, suffix)[0]))


def test_opencv_calibration_sample_keeps_a_row_per_image(tmp_path):
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in {"image_width": SIZE[0], "image_height": SIZE[1], "board_width": 9, "board_height": 6}.items():
        storage.write(name, value)
    storage.write("image_points", np.array([p for _, p in VIEWS], np.float64))
    storage.release()
    same(read_corners([tmp_path / "c.yml"]))


def test_stereo_pair_needs_camera_name(tmp_path):
    (file,), _ = opencv(tmp_path)
    text = file.read_text()
    points = text[text.index("imagePoints:") : text.index("image_width")]
    file.write_text(text.replace("imagePoints:", "imagePoints1:") + points.replace("imagePoints:", "imagePoints2:"))
    with pytest.raises(FormatError, match=r"2 cameras: imagePoints1, imagePoints2; specify one: --which imagePoints1"):
        read_corners([file])
    same(read_corners([file], which="imagePoints2"))
    with pytest.raises(FormatError, match="no corners of a camera 'left'; it holds imagePoints1"):
        read_corners([file], which="left")


def test_several_boards_form_one_target(tmp_path):
    side = np.array([[0.0, 0, 1, 2.5], [0, 1, 0, -1], [-1, 0, 0, 5]])
    count = len(BOARD.points)
    both = structs(X=[BOARD.points[:, :2].T] * 2, Rt=[np.eye(3, 4), side])
    pixels = np.concatenate([VIEWS[0][1], VIEWS[1][1]])
    which = np.concatenate([[np.arange(count) + 1, np.ones(count)], [np.arange(count) + 1, np.full(count, 2)]], 1)
    scipy.io.savemat(
        tmp_path / "cube.mat",
        {"boards": both, "corners": structs(x=[pixels.T + 1], cspond=[which]), "imgsize": SIZE[::-1]},
    )
    detections = read_corners([tmp_path / "cube.mat"])
    expected = np.concatenate([BOARD.points, BOARD.points @ side[:, :3].T + side[:, 3]])
    (seen,) = detections.images[0].boards
    order = np.argsort(seen.ids)
    np.testing.assert_allclose(detections.board.points[seen.ids[order]], expected, atol=1e-9)
    assert str(detections.board) == "108 points of a rigid body"
    (tmp_path / "t.dsc").write_text(
        "".join(f"{k},7,10,10.0\nt,2\n" + "".join(f"-1,0,0,{x},{y},0\n" for x, y, _ in BOARD.points) for k in (0, 4))
    )
    pose = " ".join(str(v) for row in side * [1, 1, 1, 10] for v in row)  # its points are in cm, its poses in mm
    (tmp_path / "t.tp").write_text(f"#calibration date: today\n0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n4\n{pose}\n")
    rows = "".join(f"{4 * (i // count)},{i % count},1,{x!r},{y!r}\n" for i, (x, y) in enumerate(pixels.tolist()))
    head = f"filename: a.png\nwidth: {SIZE[0]}\nheight: {SIZE[1]}\nnum_corners: {2 * count}\nencoding: ascii\n"
    (tmp_path / "a.orpc").write_text(head + rows)
    metric = read_corners([tmp_path / "a.orpc"])
    np.testing.assert_allclose(metric.board.points[metric.images[0].boards[0].ids], 0.01 * expected, atol=1e-9)


def test_mrcal_levels_determine_covariance(tmp_path):
    levels = ["0", "1", "2", "-"] * 14
    rows = [f"a.png {x!r} {y!r} {level}" for (x, y), level in zip(VIEWS[0][1].tolist(), levels, strict=False)]
    (tmp_path / "c.vnl").write_text("\n".join(["# filename x y level", *rows]))
    detections = read_corners([tmp_path / "c.vnl"], board=BOARD, size=SIZE)
    (seen,) = detections.images[0].boards
    assert detections.notes == ("corners that are not finite, or at (0, 0), left out: 13",)
    sigma = np.sqrt(seen.covariance[:, 0, 0])
    np.testing.assert_allclose(sigma / sigma[0], np.array([1, 2, 4, 0] * 14)[seen.ids])
    weights = {" 0": " 1", " 1": " 0.5", " 2": " 0.25", " -": " -1"}
    weights = "\n".join(row[:-2] + weights[row[-2:]] for row in rows)
    (tmp_path / "w.vnl").write_text("# filename x y weight\n" + weights)
    (again,) = read_corners([tmp_path / "w.vnl"], board=BOARD, size=SIZE).images[0].boards
    np.testing.assert_allclose(again.covariance, seen.covariance)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        ("mrcal without a board", r"the board is not in the file; it has 54 corners: specify --pattern, such as 14x14"),
        ("mrcal of another board", r"has 54 corners, the 8x6 board 48: mrgingham lists whole boards; is --pattern"),
        ("orpc without its dsc", r"needs one \.dsc beside it, .* has none"),
        ("orpc of another dsc", r"point 53 of board 0 is not in the \.dsc: does it belong to another target"),
        ("orpc cut off", r"num_corners is 54, but 50 follow: is the file cut off"),
        ("npz of objects", r"neither an image nor a corner file of a known format"),
        ("npz without a board", r"no objpoints and no pattern in it: specify --pattern, such as 9x6"),
        ("mat 7.3", r"a \.mat of version 7\.3 \(HDF5\) is not read: save it with -v7"),
        ("mat of no such point", r"refers to point 55 of board 1; there are 1 boards with 54 points"),
        ("mat turned round", r"corners\(1\): x must be 2 x N and cspond 2 x N, got 54 x 2 and 2 x 54"),
        ("text", r"begins with 'I am no'"),
    ],
)
def test_error_message_has_remedy(write, message, tmp_path):
    options = {}
    match write:
        case "mrcal without a board" | "mrcal of another board":
            files, _ = mrcal(tmp_path)
            options = {} if write.endswith("a board") else {"board": type(BOARD)(8, 6)}
        case "orpc without its dsc":
            files, _ = deltille(tmp_path)
            (tmp_path / "board.dsc").unlink()
        case "orpc of another dsc":
            files, _ = deltille(tmp_path)
            lines = (tmp_path / "board.dsc").read_text().splitlines()
            (tmp_path / "board.dsc").write_text("\n".join(lines[:-1]))
        case "orpc cut off":
            files, _ = deltille(tmp_path)
            files[0].write_text("\n".join(files[0].read_text().splitlines()[:-4]))
        case "npz of objects":
            files = [tmp_path / "o.npz"]
            np.savez(files[0], imgpoints=np.array([VIEWS[0][1], VIEWS[1][1][:5]], object))
        case "npz without a board":
            files = [tmp_path / "o.npz"]
            np.savez(files[0], imgpoints=[p for _, p in VIEWS])
        case "mat 7.3":
            files = [tmp_path / "n.mat"]
            files[0].write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")
        case "mat of no such point" | "mat turned round":
            files, _ = babelcalib(tmp_path)
            held = scipy.io.loadmat(files[0])
            if write.endswith("point"):
                held["corners"]["cspond"][0, 0][0, 0] = 55
            else:
                held["corners"]["x"][0, 0] = held["corners"]["x"][0, 0].T
            scipy.io.savemat(files[0], {key: value for key, value in held.items() if key[0] != "_"})
        case _:
            files = [tmp_path / "notes.txt"]
            files[0].write_text("I am no")
    with pytest.raises(FormatError, match=message):
        read_corners(files, **options)


def test_babelcalib_files_are_read_as_scipy_reads_them(data):
    folder = data("babelcalib_ov_plane")
    detections = read_corners([folder / "train.mat"])
    assert detections.size == (1280, 800)
    truth = scipy.io.loadmat(folder / "train.mat", squeeze_me=True, struct_as_record=False)
    step = 0.75  # cm
    for image, corners in zip(detections.images, truth["corners"], strict=True):
        (seen,) = image.boards
        order = np.lexsort(seen.pixels.T)
        theirs = corners.x.T - 1
        np.testing.assert_allclose(seen.pixels[order], theirs[np.lexsort(theirs.T)], atol=1e-9)
        points = truth["boards"].X.T[corners.cspond[0].astype(int) - 1][np.lexsort(theirs.T)] / step
        np.testing.assert_allclose(detections.board.points[seen.ids[order], :2], points, atol=1e-9)
    # The same corners as the detector wrote them, image by image, from 0, with the points in metres.
    files = sorted(folder.glob("*.orpc"))
    metric = read_corners(files)
    assert [image.path.suffix for image in metric.images] == [".png"] * len(files)
    theirs = {len(d): (detections.board.points[d.ids], d.pixels) for p in detections.images for d in p.boards}
    for image in metric.images:
        (seen,) = image.boards
        points, pixels = theirs[len(seen)]
        order, other = np.lexsort(seen.pixels.T), np.lexsort(pixels.T)
        np.testing.assert_allclose(seen.pixels[order], pixels[other], atol=1e-4)
        ours = metric.board.points[seen.ids[order]] / 0.0075
        np.testing.assert_allclose(ours, points[other], atol=1e-9)


def test_opencv_contrib_corners_are_read_as_opencv_reads_them(data):
    file = data("detected_corners_opencv_contrib") / "contrib_omni_stereocalib_data.xml"
    detections = read_corners([file], which="imagePoints2", size=(704, 576))
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    node = storage.getNode("imagePoints2")
    assert len(detections.found) == node.size() == 39
    for k, image in enumerate(detections.images):
        theirs = node.at(k).mat().reshape(-1, 2)
        np.testing.assert_allclose(image.boards[0].pixels, theirs, atol=1e-6)

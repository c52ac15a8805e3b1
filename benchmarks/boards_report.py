"""Report of detections: crops with corners, a self-contained HTML page, and the tables of the docs."""

import base64
import html
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.boards_detectors import Found
from benchmarks.boards_real import SetResult, hardest
from benchmarks.boards_rendered import Result, worst
from benchmarks.boards_scene import Shot, shoot
from omnisight.images import read_image, to_gray8

Bytes = NDArray[np.uint8]

# BGR, and how each is marked: a circle, an upright and a lying cross, so that one does not hide the other.
COLOURS = {"omnisight": (60, 200, 40), "OpenCV classic": (40, 40, 230), "OpenCV SB": (240, 120, 30)}
TRUTH = (0, 215, 255)
WIDE = 900  # px of a drawn crop, about
SHIFT = 4  # binary digits of a pixel that OpenCV draws at

STYLE = """body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 1200px; color: #222 }
table { border-collapse: collapse; font-size: 13px; margin: 1em 0 } td, th { border: 1px solid #ccc; padding: 3px 8px }
th { background: #eef } td:first-child { white-space: nowrap } figure { display: inline-block; margin: 0 1em 1em 0 }
img { max-width: 100%; border: 1px solid #999 } figcaption { font-size: 13px; max-width: 900px }"""


def draw(gray: Bytes, found: Mapping[str, Found], true: NDArray[np.float64] | None = None, margin: int = 25) -> Bytes:
    """Draw corners into an enlarged crop (BGR) around them; true corners as yellow dots."""
    given = [f.pixels for f in found.values() if len(f)]
    given += [] if true is None else [true[np.isfinite(true).all(1)]]
    left, top, right, bottom = 0, 0, gray.shape[1], gray.shape[0]
    if given and sum(map(len, given)):
        low, high = np.concatenate(given).min(0) - margin, np.concatenate(given).max(0) + margin
        left, top = np.clip(low, 0, (right - 40, bottom - 40)).astype(int)
        right, bottom = np.clip(high, (left + 40, top + 40), (right, bottom)).astype(int)
    crop = gray[top:bottom, left:right]
    zoom = float(np.clip(WIDE / max(crop.shape), 0.3, 8.0))
    shape = (max(1, round(crop.shape[1] * zoom)), max(1, round(crop.shape[0] * zoom)))
    big = cv2.resize(crop, shape, interpolation=cv2.INTER_AREA if zoom < 1 else cv2.INTER_CUBIC)
    canvas = cv2.cvtColor(big, cv2.COLOR_GRAY2BGR)

    def place(pixels: NDArray[np.float64]) -> NDArray[np.int64]:
        shown = (pixels - (left, top) + 0.5) * zoom - 0.5
        return np.rint(shown[np.isfinite(shown).all(1)] * 2**SHIFT).astype(np.int64)

    for x, y in [] if true is None else place(true).tolist():
        cv2.circle(canvas, (x, y), 2 << SHIFT, TRUTH, -1, cv2.LINE_AA, SHIFT)
    for name, f in found.items():
        for x, y in place(f.pixels).tolist() if len(f) else []:
            _mark(canvas, x, y, name)
    return canvas


def _mark(canvas: Bytes, x: int, y: int, name: str) -> None:
    colour, arm = COLOURS[name], 7 << SHIFT
    if name == "omnisight":
        cv2.circle(canvas, (x, y), 8 << SHIFT, colour, 2, cv2.LINE_AA, SHIFT)
        return
    ends = ((arm, 0), (0, arm)) if name == "OpenCV classic" else ((arm, arm), (arm, -arm))
    for dx, dy in ends:
        cv2.line(canvas, (x - dx, y - dy), (x + dx, y + dy), colour, 1, cv2.LINE_AA, SHIFT)


def draw_result(result: Result) -> Bytes:
    scene = shoot(result.shot)
    return draw(scene.image, result.found, scene.corners)


def write_worst(results: list[Result], folder: Path, count: int = 40) -> list[str]:
    """Write the images in which ours misses or errs most, with all corners drawn; give a line on each."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for i, result in enumerate(worst(results, count=count)):
        name = f"worst_{i:02d}_{result.cell}_{result.shot.lens}".replace(" ", "_").replace("%", "")
        cv2.imwrite(str(folder / f"{name}.png"), draw_result(result))
        cv2.imwrite(str(folder / f"{name}_plain.png"), shoot(result.shot).image)
        lines.append(f"{name}: {counts(result)}; {result.shot}")
    return lines


def counts(result: Result) -> str:
    each = [f"{n} {s.right} right, {s.reported - s.right} wrong" for n, s in result.scores.items()]
    return f"{next(iter(result.scores.values())).visible} visible; {'; '.join(each)}"


def page(
    tables: Mapping[str, str], rendered: list[Result], real: list[SetResult], title: str = "Finding checkerboards"
) -> str:
    """Return a page (HTML) with tables (Markdown, by title) and images; all it shows is within it."""
    parts = [
        f"<h1>{title}</h1>",
        "<p>omnisight: green circles. OpenCV classic: red +. OpenCV SB: blue x. Truth: yellow.</p>",
    ]
    for name, table in tables.items():
        parts += [f"<h2>{html.escape(name)}</h2>", _html_table(table)]
    if real:
        parts.append("<h2>The hardest image of each set</h2>")
    for result in real:
        i = hardest(result)
        found = {name: each[i] for name, each in result.found.items()}
        caption = ", ".join(f"{n}: {len(f)} ({int(result.wrong[n][i].sum())} wrong)" for n, f in found.items())
        gray = to_gray8(read_image(result.paths[i]))
        parts.append(_figure(draw(gray, found), f"{result.name}, {result.paths[i].name}. Corners by {caption}"))
    if rendered:
        parts.append("<h2>Rendered images, one of each cell</h2>")
        first: dict[str, Result] = {}
        for result in rendered:
            if result.shot.lens == "fisheye 180" and result.cell not in first and result.shot.place > 0.3:
                first[result.cell] = result
        parts += [_figure(draw_result(r), f"{cell}. {counts(r)}", 560) for cell, r in first.items()]
        parts.append("<h2>Rendered images that ours finds worst</h2>")
        parts += [_figure(draw_result(r), f"{r.cell}. {counts(r)}. {r.shot}", 560) for r in worst(rendered, count=12)]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f"<body>{''.join(parts)}</body></html>"
    )


def _figure(image: Bytes, caption: str, width: int = WIDE) -> str:
    coded = base64.b64encode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()).decode()
    return (
        f'<figure><img width="{width}" src="data:image/jpeg;base64,{coded}" alt="">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def _html_table(table: str) -> str:
    head, _, *rows = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    lines = ["<table><tr>", *(f"<th>{html.escape(c)}</th>" for c in head), "</tr>"]
    for row in rows:
        lines += ["<tr>", *(f"<td>{html.escape(c)}</td>" for c in row), "</tr>"]
    return "".join([*lines, "</table>"])


def assets(folder: Path, redistributable: Mapping[str, Path]) -> None:
    """Draw the images of the docs: rendered ones, and boards of sets whose licence lets them be shown."""
    from benchmarks.boards_detectors import DETECTORS, timed
    from benchmarks.boards_scene import BOARD
    from omnisight.targets import Checkerboard

    shots = (
        Shot("fisheye 220", 0.8, 25.0, 30.0, 3, visible=0.6),
        Shot("mirror", 0.6, 50.0, 20.0, 2, blur=2.0),
        Shot("fisheye 180", 0.6, 50.0, 20.0, 2, noise=5.0, light=3.0),
    )
    for i, shot in enumerate(shots):
        scene = shoot(shot)
        _small(
            folder / f"detection-{i + 1}.jpg", draw(scene.image, {n: timed(n, scene.image, BOARD) for n in DETECTORS})
        )
    for name, path in redistributable.items():
        gray, board = to_gray8(read_image(path)), Checkerboard(11, 7)
        found = {n: timed(n, gray, board) for n in DETECTORS}
        if any(map(len, found.values())):
            _small(folder / f"detection-{name}.jpg", draw(gray, found, margin=12))


def _small(path: Path, image: Bytes) -> None:
    for quality in (88, 80, 70, 60):
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        if len(data) < 150_000:
            break
    path.write_bytes(data)

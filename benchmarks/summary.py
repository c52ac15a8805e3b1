"""The table of the README: accuracy and speed compared with other libraries, from the tables of results in docs/.

`python -m benchmarks summary` prints it; a test checks that the README contains it.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

DOCS = Path(__file__).resolve().parent.parent / "docs"
ADDRESS = "https://github.com/omnisight/omnisight/blob/main/docs/"

Row = dict[str, str]


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    print(summary())


def summary() -> str:
    """Return the table."""
    tables = [detection(), calibration(), rigs(), projection(), remapping(), two_views()]
    tables += [reconstruction(), motion(), stitching()]
    lines = ["| task | measure | omnisight | peer |", "|---|---|---|---|"]
    return "\n".join([*lines, *(line for table in tables for line in table)])


def rows(page: str) -> list[Row]:
    """Return the rows of all tables of a page, by the names of their columns; empty cells repeat the one above."""
    found, header, above = list[Row](), list[str](), list[str]()
    for line in (DOCS / page).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            header, above = [], []
        elif not header:
            header = cells
        elif not set(cells[0]) <= set("-: ") or not cells[0]:
            above = [cells[0] or above[0], *cells[1:]]
            found.append(dict(zip(header, above, strict=False)))
    return found


def one(page: str, **cells: str) -> Row:
    """Return the only row of a page with these cells; names of columns have _ for spaces."""
    wanted = {name.replace("_", " "): value for name, value in cells.items()}
    found = [row for row in rows(page) if wanted.items() <= row.items()]
    if len(found) != 1:
        raise ValueError(f"docs/{page} has {len(found)} rows with {wanted}, not one: change benchmarks/summary.py")
    return found[0]


def entry(task: str, measure: str, ours: str, theirs: str, page: str) -> str:
    """Return a line of the table."""
    return f"| [{task}]({ADDRESS}{page}) | {measure} | {ours} | {theirs} |"


def detection() -> list[str]:
    page = "detection-results.md"
    name = "omnisight / OpenCV classic / OpenCV SB"
    found = next(row for row in rows(page) if row.get(name) == "all")
    measures = {"recall of corners": ("recall, %", "%"), "rms error": ("rms, px", "px"), "one thread": ("ms", "ms")}
    lines = list[str]()
    for measure, (column, unit) in measures.items():
        ours, classic, sector = found[column].split(" / ")
        theirs = f"OpenCV classic {classic} {unit}, SB {sector} {unit}"
        lines.append(entry("detect a checkerboard", measure, f"{ours} {unit}", theirs, page))
    return lines


def calibration() -> list[str]:
    page, peer = "solvers-results.md", "cv2.omnidir"
    by_solver = {
        solver: {row["corners"]: row for row in rows(page) if (row.get("model"), row.get("solver")) == ("mei", solver)}
        for solver in ("ours", peer)
    }
    common = [name for name, row in by_solver[peer].items() if row["held out, px"] and name in by_solver["ours"]]

    def over_sets(solver: str, column: str) -> float:
        return median(float(by_solver[solver][name][column]) for name in common)

    task = f"calibrate (Mei), {len(common)} sets of real corners"
    return [
        entry(task, f"median {measure}", f"{over_sets('ours', column):{form}}", f"{peer} {theirs:{form}}", page)
        for measure, column, form in (("held-out error, px", "held out, px", ".3f"), ("CPU time, s", "CPU s", ".2f"))
        for theirs in [over_sets(peer, column)]
    ]


def rigs() -> list[str]:
    page = "rigs-results.md"
    ours = one(page, rig="stereo", cameras="two fisheyes of 150°, 0.11 m apart")
    figures = f"{ours['rotation °']}°, {ours['translation mm']} mm"
    measure = "error with 5 % outliers"
    methods = ("`cv2.fisheye`", "`cv2.stereoCalibrate`")
    peer = "; ".join(f"{each} {one(page, rig='stereo', method=each)['with outliers']}" for each in methods)
    return [entry("calibrate a stereo rig of fisheyes", measure, figures, peer, page)]


def _race(task: str, *works: str) -> list[str]:
    page = "benchmarks-results.md"
    lines = list[str]()
    for work in works:
        found = one(page, work=work)
        lines.append(entry(task, work, found["ours"], f"{found['peer']} {found['theirs']}", page))
    return lines


def projection() -> list[str]:
    return _race("project", "project 1 M, Mei", "unproject 1 M, Mei", "project 1 M, EUCM", "unproject 1 M, EUCM")


def remapping() -> list[str]:
    return _race("view", "1080p map, Mei to perspective", "remap 4K to 1080p, RGB, bilinear, map computed before")


def two_views() -> list[str]:
    page, name = "twoview-results.md", "motion, field of view, outliers, noise"
    cells = [row for row in rows(page) if name in row]

    def medians(column: str, count: int) -> list[float]:
        """Return the median of each method over the cells in which `count` methods took part."""
        values = [[float(value) for value in row[column].split(" / ")] for row in cells]
        return [median(each) for each in zip(*(value for value in values if len(value) == count), strict=True)]

    lines = list[str]()
    for count, peers in ((3, ("pycolmap", "PoseLib")), (2, ("pycolmap",))):
        used = sum(row["CPU ms"].count(" / ") == count - 1 for row in cells)
        task = f"relative pose, {'up to 120°' if count == 3 else '190° to 360°'}, {used} cells"
        for measure, column, form in (("rotation error", "rotation °", ".3f"), ("CPU time", "CPU ms", ".1f")):
            ours, *theirs = medians(column, count)
            unit = "°" if "°" in column else " ms"
            others = ", ".join(f"{peer} {value:{form}}{unit}" for peer, value in zip(peers, theirs, strict=True))
            lines.append(entry(task, f"median {measure}", f"{ours:{form}}{unit}", others, page))
    return lines


def reconstruction() -> list[str]:
    page = "guide/reconstruct.md"
    lines = list[str]()
    for images in ("room, 30 of 360°", "street, 30 of 360°", "town, 500 of 360°"):
        methods = {row["method"].split(", `")[0]: row for row in rows(page) if row.get("images") == images}
        figure: Callable[[Row], str] = lambda row: f"{row['position']}, {row['rotation']}, {row['time']}"  # noqa: E731
        ours = figure(methods.pop("omnisight"))
        theirs = "; ".join(f"{method} {figure(row)}" for method, row in methods.items())
        lines.append(entry(f"reconstruct ({images})", "position, rotation, time", ours, theirs, page))
    adjusted = [row for row in rows(page) if "cost within 0.01 % of the optimum" in row]
    ours, theirs = (row["cost within 0.01 % of the optimum"] for row in adjusted)
    peer = re.split(r",|\(", adjusted[1]["method"])[0].strip()
    return [*lines, entry("bundle adjustment, 200 poses", "time to the optimum", ours, f"{peer} {theirs}", page)]


def motion() -> list[str]:
    page = "guide/odometry.md"
    lines = list[str]()
    for sequence in ("room, fisheye", "town, 360"):
        used = [row for row in rows(page) if row.get("sequence") == sequence and "method" in row]
        ours, theirs = (f"{row['error']}, {row['drift, °/m']}°/m, {row['time']}" for row in used)
        task = f"visual odometry ({sequence})"
        lines.append(entry(task, "error, drift, time", ours, f"{used[1]['method']}, incremental {theirs}", page))
    return lines


def stitching() -> list[str]:
    page = "guide/stitch.md"
    lines = list[str]()
    for scene in ("room, 4 cm", "street, 4 cm"):
        methods = {row["method"]: row for row in rows(page) if row.get("scene, baseline") == scene}
        ours = f"{methods['omnisight, rig']['PSNR dB']} dB, uncalibrated"
        ours += f" {methods['omnisight, without calibration']['PSNR dB']} dB"
        theirs = ", ".join(f"{name} {methods[name]['PSNR dB']} dB" for name in ("ffmpeg v360", "nona and enblend"))
        lines.append(entry(f"stitch ({scene})", "PSNR at the seam", ours, theirs, page))
    return lines

"""Board detection compared with OpenCV: `python -m benchmarks.boards [rendered] [real] [times] [check]`.

Without names all parts run, some fifteen minutes on two cores. To try one thing: `rendered --only base,blur --quick`.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import cv2

from benchmarks import boards_check, boards_real, boards_rendered, boards_report, boards_times
from benchmarks.boards_detectors import DETECTORS

PARTS = ("check", "rendered", "real", "times")
ROOT = Path(__file__).resolve().parent.parent
TITLES = {"rendered": "Rendered images", "real": "Real images", "times": "Times"}
TABLES = {"rendered": boards_rendered.table, "real": boards_real.table, "times": boards_times.table}
ABOUT = {
    "rendered": "Recall and precision by corners within 2 px of a visible true one. A wrong id of ours counts"
    " as wrong unless the detection reports an ambiguous position. NEES is e^T C^-1 e / 2, its mean"
    " and its median over that of chi-square: 1 is a correct covariance. Milliseconds are medians of one"
    " thread. OpenCV gets the pattern and detects complete boards only.",
    "real": "Wrong: more than 2 px from the fit of the image's pose by the camera that our corners calibrate. rms: of"
    " a mei model by plain least squares on the corners that both found, their number in brackets. Ours gets no"
    " pattern.",
    "times": "Two threads, the process warm.",
}


def main(arguments: list[str] | None = None) -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.boards", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all unless given")
    parser.add_argument("--only", default="", help="cells of the rendered images (base, mix, blur, ...), or sets")
    parser.add_argument("--quick", action="store_true", help="fewer rendered images, and times up to 5 MP")
    parser.add_argument("--ours", action="store_true", help="rendered images by our detector alone")
    parser.add_argument("--json", type=Path, help="write all figures to this file")
    parser.add_argument("--report", type=Path, help="write a page with images into this folder")
    parser.add_argument("--worst", type=Path, help="write the rendered images that ours finds worst into this folder")
    parser.add_argument("--docs", type=Path, help="only write the results page of the docs, from this JSON file")
    chosen = parser.parse_args(arguments)
    if chosen.docs:
        write_docs(json.loads(chosen.docs.read_text()))
        return
    if unknown := set(chosen.parts) - set(PARTS):
        parser.error(f"unknown part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    only = tuple(filter(None, chosen.only.split(",")))
    parts = chosen.parts or PARTS
    figures: dict[str, Any] = {"opencv": cv2.__version__}
    rendered, real = [], []
    if "check" in parts:
        figures["check"] = boards_check.run()
        print(figures["check"], flush=True)
    if "rendered" in parts:
        names = ("omnisight",) if chosen.ours else tuple(DETECTORS)
        rendered = boards_rendered.measure(only, quick=chosen.quick, names=names)
        figures["rendered"] = boards_rendered.figures(rendered)
        _show("rendered", figures)
    if "real" in parts:
        real = boards_real.measure(only)
        figures["real"] = boards_real.figures(real)
        _show("real", figures)
    if "times" in parts:
        figures["times"] = boards_times.measure((1, 5) if chosen.quick else tuple(boards_times.SIZES))
        _show("times", figures)
    if chosen.json:
        chosen.json.write_text(json.dumps(figures, indent=1))
    if chosen.worst:
        print("\n".join(boards_report.write_worst(rendered, chosen.worst)))
    if chosen.report:
        chosen.report.mkdir(parents=True, exist_ok=True)
        tables = {TITLES[part]: table(figures[part]) for part, table in TABLES.items() if part in figures}
        (chosen.report / "index.html").write_text(boards_report.page(tables, rendered, real))
        print(f"wrote {chosen.report / 'index.html'}")


def _show(part: str, figures: dict[str, Any]) -> None:
    print(f"\n{TITLES[part]}\n\n{TABLES[part](figures[part])}", flush=True)
    for name, row in figures[part].items() if part == "real" else ():
        for note in row["notes"]:
            print(f"{name}: {note}")


def write_docs(figures: dict[str, Any]) -> None:
    """Write docs/detection-results.md, which the page on detection includes, and its images."""
    lines = ["# Results", "", f"OpenCV {figures['opencv']}, two cores. {figures.get('check', '').capitalize()}", ""]
    for part, table in TABLES.items():
        if part in figures:
            lines += [f"## {TITLES[part]}", "", ABOUT[part], "", table(figures[part]), ""]
    (ROOT / "docs/detection-results.md").write_text("\n".join(lines))
    kaidan = boards_real.DATA / "kaidan_catadioptric/KaidanOmni8.jpg"
    boards_report.assets(ROOT / "docs/assets", {"kaidan": kaidan} if kaidan.exists() else {})


if __name__ == "__main__":
    main()

"""Report of `omnisight compass`."""

import numpy as np

from omnisight.cli._output import write_json
from omnisight.pipeline.localization.compass import CompassResult

# Standard deviation, degrees, from which ± 2σ is half a turn or more.
UNKNOWN_DEG = 45.0


def print_json(result: CompassResult) -> None:
    """Print the result as one JSON object."""
    data = {
        "headings": [
            {
                "name": each.name,
                "nearest": each.nearest,
                "heading_deg": each.heading_deg,
                "sigma_deg": each.sigma_deg,
                "similarity": each.similarity,
            }
            for each in result.headings
        ],
        "references": result.references,
        "failed": result.failed,
        "reason": result.reason,
    }
    write_json(data)


def print_report(result: CompassResult) -> None:
    """Print a table of the headings, and the images that have none."""
    names = max(5, *(len(each.name) for each in result.headings))
    nearest = max(7, *(len(each.nearest) for each in result.headings))
    print(f"{'image':<{names}}  {'nearest':<{nearest}}  heading  sigma  similarity")
    for each in result.headings:
        print(
            f"{each.name:<{names}}  {each.nearest:<{nearest}}  {each.heading_deg:+6.1f}°  {each.sigma_deg:4.1f}°"
            f"  {each.similarity:10.2f}"
        )
    for name, reason in result.failed.items():
        print(f"left out  {name}: {reason}")
    # Without --reference, the first image is the reference of all, and its own heading is zero by definition.
    sigmas = [each.sigma_deg for each in result.headings if not each.is_reference]
    sigma = float(np.median(sigmas)) if sigmas else 0.0
    references = "1 reference" if result.references == 1 else f"{result.references} references"
    print(f"headings  {len(result.headings)}, {references}, ± {sigma:.2f}° (1σ, median)")
    unknown = sum(each.sigma_deg >= UNKNOWN_DEG for each in result.headings)
    if unknown:
        print(f"note      {unknown} unknown (σ of {UNKNOWN_DEG:g}° or more): probably no reference shows the place")

"""Timing two ways of doing the same work, in turn, so that a noisy machine is noisy for both."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Race:
    """What was measured.

    Attributes
    ----------
    work
        What was done.
    ours, theirs
        Median time, seconds.
    peer
        Who.
    target
        The ratio theirs/ours to reach.
    note
        Differences in the results, or what else to know.
    """

    work: str
    ours: float
    theirs: float
    peer: str
    target: float
    note: str = ""

    @property
    def ratio(self) -> float:
        return self.theirs / self.ours


def race(
    work: str,
    ours: Callable[[], object],
    theirs: Callable[[], object],
    peer: str,
    target: float,
    *,
    runs: int = 15,
    note: str = "",
) -> Race:
    """Run both once to warm up, then in turn, and take the medians."""
    ours(), theirs()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(runs):
        for function, taken in zip((ours, theirs), times, strict=True):
            begun = time.perf_counter()
            function()
            taken.append(time.perf_counter() - begun)
    return Race(work, median(times[0]), median(times[1]), peer, target, note)


def table(races: list[Race]) -> str:
    """Give the races as a Markdown table."""
    lines = ["| work | ours | peer | theirs | ratio | at least | |", "|---|---|---|---|---|---|---|"]
    for r in races:
        reached = "yes" if r.ratio >= r.target else "**no**"
        note = f"{reached}; {r.note}" if r.note else reached
        ours, theirs = f"{r.ours * 1e3:.3g} ms", f"{r.theirs * 1e3:.3g} ms"
        lines.append(f"| {r.work} | {ours} | {r.peer} | {theirs} | {r.ratio:.1f}x | {r.target:g}x | {note} |")
    return "\n".join(lines)

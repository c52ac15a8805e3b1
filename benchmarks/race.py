"""Time two implementations of the same work alternately, so that other load on the machine affects both."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median


@dataclass(frozen=True)
class Race:
    """Times of the same work in omnisight and in another library.

    Attributes
    ----------
    work
        Description of the work.
    ours, theirs
        Median times, seconds.
    peer
        Name of the other library, or of a fixed limit.
    target
        Required ratio theirs/ours.
    note
        Difference of the results, or another remark.
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
    """Run both once to warm up, then alternately, and return the medians."""
    ours(), theirs()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(runs):
        for function, taken in zip((ours, theirs), times, strict=True):
            start = time.perf_counter()
            function()
            taken.append(time.perf_counter() - start)
    return Race(work, median(times[0]), median(times[1]), peer, target, note)


def table(races: list[Race]) -> str:
    """Return a Markdown table of the races."""
    lines = ["| work | ours | peer | theirs | ratio | at least | |", "|---|---|---|---|---|---|---|"]
    for r in races:
        reached = "yes" if r.ratio >= r.target else "**no**"
        note = f"{reached}; {r.note}" if r.note else reached
        ours, theirs = f"{r.ours * 1e3:.3g} ms", f"{r.theirs * 1e3:.3g} ms"
        lines.append(f"| {r.work} | {ours} | {r.peer} | {theirs} | {r.ratio:.1f}x | {r.target:g}x | {note} |")
    return "\n".join(lines)

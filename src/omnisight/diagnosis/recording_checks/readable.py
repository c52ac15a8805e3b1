"""Check that the images can be used."""

from omnisight.diagnosis.finding import Finding, Level
from omnisight.diagnosis.recording import Recording

PRIORITY = 5


def check(recording: Recording) -> Finding:
    """Check that the examined images can be read and have one size."""
    count, bad = len(recording.frames), recording.unreadable
    if not count:
        return Finding("images", Level.FAILED, bad[0] if bad else "there are no images", "copy the images again")
    first, last = recording.frames[0], recording.frames[-1]
    figure = f"{count} examined, from {first.index} to {last.index} ({last.seconds - first.seconds:.1f} s)"
    if bad:
        text = f"{figure}; {len(bad)} cannot be used, the first: {bad[0]}"
        return Finding("images", Level.WARNING, text, "copy them again, or leave out those of another size")
    return Finding("images", Level.OK, figure)

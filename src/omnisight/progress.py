"""The functions that long tasks call to report their progress."""

from collections.abc import Callable

# Called with the stage, the number of finished items and the number of all items.
Progress = Callable[[str, int, int], None]
# Called with the number of finished items and the number of all items of one stage.
StageProgress = Callable[[int, int], None]


def no_progress(*_: object) -> None:
    """Report nothing."""

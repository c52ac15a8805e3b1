"""Figures of matplotlib, which is imported at their first use."""

from typing import Any

WIDTH, HEIGHT = 6.4, 4.4  # inches


def new_figure(*, width: float = WIDTH, height: float = HEIGHT) -> Any:
    """Return an empty figure; a notebook shows it once, as the value of a cell.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    try:
        # The import registers the display of figures in notebooks; a figure of pyplot itself would be shown twice.
        import matplotlib.pyplot  # noqa: F401  # pyright: ignore[reportUnusedImport]
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'omnisight[plot]'") from None
    return Figure(figsize=(width, height), layout="constrained")


def new_axes(**size: float) -> tuple[Any, Any]:
    """Return a figure and its only axes; see `new_figure`."""
    figure = new_figure(**size)
    return figure, figure.add_subplot()

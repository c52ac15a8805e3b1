"""Wording that several checks and messages share."""

from collections.abc import Sequence

# Items that a message names.
MAX_NAMED = 3


def list_first(items: Sequence[str], separator: str = ", ") -> str:
    """Join the first items, with an ellipsis if there are more."""
    return separator.join([*items[:MAX_NAMED], *(["..."] if len(items) > MAX_NAMED else [])])

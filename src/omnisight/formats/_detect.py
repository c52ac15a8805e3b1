"""Distinguish formats by their keys."""

import re

from omnisight.formats._limits import HEAD_CHARS, SEARCHED_CHARS


def is_json_with(text: str, *keys: str) -> bool:
    """Return whether a text is a JSON object of another tool that contains one of these keys."""
    if not text.lstrip().startswith("{") or '"omnisight' in text[:HEAD_CHARS]:
        return False
    return re.search(rf'"(?:{"|".join(keys)})"\s*:', text) is not None


def has_lines(text: str, *keys: str, indented: bool = False) -> bool:
    """Return whether lines of a YAML text begin with each of these keys (regular expressions)."""
    head, space = text[:SEARCHED_CHARS], "[ \t]*" if indented else ""
    return all(re.search(rf"^{space}{key}[ \t]*:", head, re.MULTILINE) for key in keys)

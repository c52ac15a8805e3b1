"""The provenance that a written camera file starts with."""

import datetime


def tool_provenance() -> dict[str, str]:
    """Return the program, its version and the time in UTC."""
    import omnisight

    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    return {"tool": f"omnisight {omnisight.__version__}", "date": date}

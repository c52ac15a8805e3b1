"""Entry to the compiled loops; numba is imported by the first call."""

from typing import Any

from omnisight.parallel import parallel_for


def run_compiled(loop: str, models: tuple[str, ...], *arguments: Any, count: int, grain: int = 16384) -> None:
    """Run a loop of `_kernels` for models by name over `count` rows, in parallel with at least `grain` rows each."""
    from omnisight.models._kernels import compiled  # imports numba, which takes a quarter of a second

    function = compiled(loop, *models)
    parallel_for(lambda first, last: function(*arguments, first, last), count, grain)

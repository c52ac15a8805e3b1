"""Random processes of the sensors."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def gauss_markov(times: Array, width: int, rng: np.random.Generator) -> Array:
    """Return a stationary first-order Gauss-Markov process (N, width) of variance 1 at times (N,), correlation times.

    Its correlation over a time t is exp(-t).
    """
    keep = np.exp(-np.diff(times))
    drawn = rng.standard_normal((len(times), width))
    for i, kept in enumerate(keep.tolist(), 1):
        drawn[i] = kept * drawn[i - 1] + np.sqrt(1 - kept**2) * drawn[i]
    return drawn

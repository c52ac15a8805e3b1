"""Arrays of other libraries (PyTorch, JAX, CuPy ...): taken as NumPy arrays, and answered in their kind."""

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray


def to_numpy(array: Any) -> Any:
    """Return an array of another library as a NumPy array, and anything else as it is.

    Raises
    ------
    ValueError
        If the array takes part in automatic differentiation, which the result would silently leave.
    """
    if isinstance(array, np.ndarray) or not hasattr(array, "__dlpack__"):
        return array
    if getattr(array, "requires_grad", False):
        raise ValueError("the tensor requires gradients, which are not computed here: pass tensor.detach()")
    if hasattr(array, "cpu"):  # PyTorch
        array = array.cpu()
    elif hasattr(array, "get"):  # CuPy
        return array.get()
    try:
        return np.from_dlpack(array)
    except (BufferError, RuntimeError, TypeError):  # memory of another device, or a type that DLPack lacks
        return np.asarray(array)


def like(array: Any, *results: NDArray[Any]) -> Any:
    """Return results as arrays of the library, the device and the precision of an array; NumPy's as they are."""
    if isinstance(array, np.ndarray) or not hasattr(array, "__dlpack__"):
        first, *others = results
    else:
        first, *others = (_like(array, result) for result in results)
    return (first, *others) if others else first


def _like(array: Any, result: NDArray[Any]) -> Any:
    """Return a result in the kind of an array of another library; floats have the precision of its floats."""
    namespace: Any = (
        array.__array_namespace__()
        if hasattr(array, "__array_namespace__")
        else sys.modules[type(array).__module__.partition(".")[0]]
    )
    is_float = np.issubdtype(result.dtype, np.floating) and "float" in str(array.dtype)
    converted = namespace.asarray(np.ascontiguousarray(result), **({"dtype": array.dtype} if is_float else {}))
    if hasattr(converted, "to"):  # PyTorch
        return converted.to(array.device)
    return namespace.asarray(converted, device=array.device) if hasattr(array, "device") else converted

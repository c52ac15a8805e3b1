"""How the compiled parts are compiled: the outer functions once for all processes, the inner ones into them."""

import numba

outer = numba.njit(cache=True, nogil=True, error_model="numpy")
inner = numba.njit(nogil=True, error_model="numpy")

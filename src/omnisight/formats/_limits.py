"""Limits on what a file may claim or hold: a hostile file costs no more than its length.

Calibration files are a few kilobytes and corner files a few megabytes; each limit is far above what any tool writes.
"""

MAX_FILE_BYTES = 50_000_000
MAX_UNPACKED_BYTES = 16_000_000  # of a compressed array or variable
MAX_TEXT_CHARS = 10_000_000  # of a text that is parsed as YAML, JSON or XML
MAX_DEPTH = 30  # of nested lists, maps, elements or structs; a recursive reader stays far from Python's own limit
MAX_ENTRIES = 2_000_000  # numbers of a matrix, lines of a table
MAX_ARRAYS = 100  # in an .npz
MAX_CAMERAS = 100_000  # in a file that lists one camera per image
MAX_DISTINCT_CAMERAS = 200  # in a file whose cameras are each built
MAX_PARAMETERS = 2000  # of a camera model; the largest spline has some hundred
MAX_POLYNOMIAL_TERMS = 20  # of Scaramuzza's f(r), which is compiled for each number of terms; OCamCalib writes 4
MAX_INVERSE_TERMS = 99  # of its inverse polynomial
MAX_NAME_CHARS = 80
HEAD_CHARS = 2000  # in which the marks of a JSON or XML file stand
SEARCHED_CHARS = 1_000_000  # in which the keys of a format are searched

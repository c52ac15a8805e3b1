"""Export of reconstructions: the counterpart of `omnisight export`."""

from pathlib import Path

from omnisight.reconstructions import ExportOptions, export_reconstruction, read_reconstruction


def export(model: str | Path, output: str | Path, options: ExportOptions) -> tuple[Path, ...]:
    """Write the reconstruction of a folder in a format of another program.

    Parameters
    ----------
    model
        A folder that `omnisight reconstruct` wrote.
    output
        The folder of the files; it is created.
    options
        The format, the folder of the images, and the size of views.

    Returns
    -------
    files
        The files that were written.

    Raises
    ------
    ReconstructionError
        If the folder has no reconstruction, the format cannot hold it, or a file cannot be written.
    """
    return export_reconstruction(read_reconstruction(model), output, options)

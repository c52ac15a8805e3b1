"""Exports of simulated data sets: each file of this folder without a leading underscore writes one format.

Formats are discovered by these files.
"""

from omnisight.simulation.exports._protocol import SequenceExport, SimulatedSequence
from omnisight.simulation.exports._registry import export_names, get_export, remove_exports, write_exports

__all__ = ["SequenceExport", "SimulatedSequence", "export_names", "get_export", "remove_exports", "write_exports"]

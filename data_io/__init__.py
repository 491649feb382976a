"""Tribometer logs as records in SI: readers, writers, units, quality. Knows files, never physics."""

from data_io.open import read_log
from data_io.record import Record
from data_io.values import Finding, LogError, LogTooLargeError, Step
from data_io.write import write_csv, write_hdf5

__all__ = [
    "Finding",
    "LogError",
    "LogTooLargeError",
    "Record",
    "Step",
    "read_log",
    "write_csv",
    "write_hdf5",
]

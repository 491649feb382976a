"""Tribometer logs as records in SI: readers, writers, units, quality. Knows files, never physics."""

from data_io.errors import LogError
from data_io.frozen import Finding, Step
from data_io.open import read_log
from data_io.record import Record
from data_io.write import write_csv, write_hdf5

__all__ = ["Finding", "LogError", "Record", "Step", "read_log", "write_csv", "write_hdf5"]

"""Freed memory is kept: arrays that come and go cost no page faults, which they do otherwise."""

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
import numpy as np
from identify.base.heap import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
def step():
    some = [np.ones(300_000) for _ in range(8)]
step(), step()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    step()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc learns from blocks that come and go")
def test_arrays_that_come_and_go_take_no_page_faults():
    faults = {}
    for mode in ("kept", "given back"):
        done = subprocess.run([sys.executable, "-c", FAULTS, mode], check=True, capture_output=True, text=True)
        faults[mode] = int(done.stdout)
    assert faults["kept"] < 0.02 * faults["given back"], faults

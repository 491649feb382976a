"""Tests run in CasADi's virtual machine and leave no machine code behind; tests of machine code ask for it."""

import os

os.environ.setdefault("STICKSLIP_COMPILE", "0")

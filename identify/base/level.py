"""The level of every interval that is told, and what it means in standard deviations."""

from __future__ import annotations

from identify.base.quantiles import normal

LEVEL = 0.95
NORMAL = normal(0.5 + LEVEL / 2)  # half width of an interval in standard deviations

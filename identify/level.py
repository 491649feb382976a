"""The level of every interval that is told, and what it means in standard deviations."""

from __future__ import annotations

from scipy.stats import norm

LEVEL = 0.95
NORMAL = float(norm.ppf(0.5 + LEVEL / 2))  # half width of an interval in standard deviations

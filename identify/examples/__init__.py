"""Example logs that ship with the package: one simulated pair, and where its files are.

Made by experiments/make_example_logs.py; truth, noise and seed stand in truth.json.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent
SCENE = FOLDER / "pair.toml"
"""Four drive speeds of the pair, to be fitted together."""
SCENE_AT_50_HZ = FOLDER / "pair_at_50_Hz.toml"
"""One speed of the same pair, sampled at 50 Hz."""
SCENE_UNEVEN = FOLDER / "pair_uneven.toml"
"""One speed of the same pair, on a surface on which no two sticks are equally strong."""
TRUTH = FOLDER / "truth.json"
"""What was simulated: parameters, rig, normal force, noise and seed."""

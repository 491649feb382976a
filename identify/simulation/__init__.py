"""The model forward in time: steps, rest, slip and sliding with located switches, up to a simulated record."""

"""The model forward in time: rest, slip and sliding with located switches, up to a simulated record."""

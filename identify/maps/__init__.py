"""Maps over two quantities and continuations over one: their grids, boundaries, bands and data."""

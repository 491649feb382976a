"""The multiple-shooting problem: its blocks and layout, its numbers and derivatives, and its solution in passes."""

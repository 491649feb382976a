"""Answers at an operating point: stability, amplitude, advice, how sure they are, the closed forms beside them."""

"""Numerics that know nothing of friction: machine code, step formulas, roots, exact derivatives, quantiles."""

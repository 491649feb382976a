"""What follows from a model: closed forms, orbits, stability and amplitude at an operating point, maps."""

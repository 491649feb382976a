"""From a scene and its records to what the estimator takes: samples, loads, cycles, and what is searched."""

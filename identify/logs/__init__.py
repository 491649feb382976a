"""From a record to what the estimator takes: samples, load, noise, cycles, quality and the classical table."""

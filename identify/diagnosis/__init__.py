"""What was found, and why a model misfits: what may be wrong with rig, sensor or model."""

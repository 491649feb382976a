"""Which effects a model takes: by the numbers of a scene, or by what the logs call for and pay for."""

"""What a fit starts from: parameters from features of the logs, and the motion behind a log placed on its data."""

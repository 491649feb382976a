"""The log that would tell: what a further log is expected to add, before it is recorded."""

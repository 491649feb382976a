"""Stick and slip in a measured force, without a model: phases, noise, the classical table, doubts about a log."""

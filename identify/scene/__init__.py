"""Scenes: what is fitted or simulated, as frozen values, and the TOML file they come from."""

from identify.scene.scene import Scene
from identify.scene.values import Contact, DriveSpeed, Initial, LogEntry, ParameterSpec, Rig

__all__ = ["Contact", "DriveSpeed", "Initial", "LogEntry", "ParameterSpec", "Rig", "Scene"]

"""Task and motion planning for two arms: a scene file in, a checked motion out."""

__version__ = "0.8.1"

"""The fixed part of a scene: robots, where they stand, the table."""

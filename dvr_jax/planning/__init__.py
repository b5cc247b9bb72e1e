"""From a scene to a checked motion: search, path, check."""

"""Pictures of scenes and motions, cast by rays."""

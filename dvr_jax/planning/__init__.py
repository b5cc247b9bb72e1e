"""From a scene to a checked motion: planning, verdicts on given sequences, sweeps over many scenes."""

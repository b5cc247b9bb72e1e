"""The augmented-Lagrangian Gauss-Newton solver for batches of nonlinear programs."""

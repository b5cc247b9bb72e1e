"""Benchmarks: each compares with something it did not make, in one run."""

"""Experiments with known effects, run by hand; their results are kept in
profiling/results/experiments.
"""

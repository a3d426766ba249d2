"""Check, then time, every operation of cvkern beside its peers: ``python -m profiling --help``."""

"""Check, then time, every operation of cvkern and its peers: ``python -m profiling --help``."""

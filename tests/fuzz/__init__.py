"""Random calls of every function, right and wrong: ``python -m tests.fuzz --calls N --seed S``."""

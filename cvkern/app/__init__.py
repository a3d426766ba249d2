"""The ``cvkern`` command, its tour of the library, and its checks of a machine."""

"""The tests, by family as in cvkern/."""

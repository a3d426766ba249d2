"""Recognition of objects: visual words, and an implicit shape model."""

from cvkern.recognition.codebook import Codebook, learn_codebook
from cvkern.recognition.models import Objects, ShapeModel

__all__ = ["Codebook", "Objects", "ShapeModel", "learn_codebook"]

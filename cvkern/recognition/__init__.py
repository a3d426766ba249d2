"""Recognition of objects: visual words, and an implicit shape model."""

from cvkern.recognition.codebook import Codebook, learn_codebook
from cvkern.recognition.models import Objects, Segmentation, ShapeModel

__all__ = ["Codebook", "Objects", "Segmentation", "ShapeModel", "learn_codebook"]

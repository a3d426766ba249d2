"""Recognition of objects: visual words, and an implicit shape model."""

from cvkern.recognition.codebook import Codebook, learn_codebook
from cvkern.recognition.figures import Objects, Segmentation
from cvkern.recognition.models import ShapeModel

__all__ = ["Codebook", "Objects", "Segmentation", "ShapeModel", "learn_codebook"]

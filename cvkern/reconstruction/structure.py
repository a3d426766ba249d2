"""Structure from motion."""

from __future__ import annotations

from cvkern.reconstruction._growth import Growth

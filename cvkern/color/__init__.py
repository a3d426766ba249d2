"""Colour: spectra, observers, spaces, metamers, adaptation, and the colour of the light."""

from cvkern.color.adaptation import adapt_colors, adaptation_matrix
from cvkern.color.constancy import estimate_illuminant, white_balance
from cvkern.color.contrast import equalize_adapthist, equalize_hist
from cvkern.color.differences import deltaE_ciede2000
from cvkern.color.illusions import Illusion, illusion, lateral_inhibition
from cvkern.color.metamers import metamer, metameric_difference
from cvkern.color.spaces import convert_color
from cvkern.color.spectra import (
    Spectrum,
    color_chart,
    spectrum_to_xyz,
    standard_light,
    standard_observer,
)
from cvkern.color.surroundings import retinex

__all__ = [
    "Illusion",
    "Spectrum",
    "adapt_colors",
    "adaptation_matrix",
    "color_chart",
    "convert_color",
    "deltaE_ciede2000",
    "equalize_adapthist",
    "equalize_hist",
    "estimate_illuminant",
    "illusion",
    "lateral_inhibition",
    "metamer",
    "metameric_difference",
    "retinex",
    "spectrum_to_xyz",
    "standard_light",
    "standard_observer",
    "white_balance",
]

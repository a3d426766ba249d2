"""What is asked of a product of samples and weights, beside its operands."""

import warp as wp


@wp.struct
class Product:
    """A layer, or the way back through it."""

    columns: int  # columns of the result
    column_in: int  # the first that is read
    column_out: int  # the first that is written
    relu: bool  # whether what is below 0 becomes 0
    gated: bool  # whether the result is 0 where the gates are


def product_of(columns: int, column_in: int, column_out: int, relu: bool, gated: bool) -> Product:
    """Return a product of these properties."""
    made = Product()
    made.columns, made.column_in, made.column_out = columns, column_in, column_out
    made.relu, made.gated = relu, gated
    return made

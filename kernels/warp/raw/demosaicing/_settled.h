#pragma once
// needs SETTLED
// An estimate, or 0 if it is so small that it is the rounding error of a zero.
const auto settled = [](float value) { return value < SETTLED && value > -SETTLED ? 0.0f : value; };

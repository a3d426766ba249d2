#pragma once
// needs LEAST
// An estimate, or 0 if it is so small that it is the rounding error of a zero.
const auto settled = [](float value) { return value < LEAST && value > -LEAST ? 0.0f : value; };

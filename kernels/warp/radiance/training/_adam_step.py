"""The step of Adam for one number [Kingma and Ba 2015], in C."""

# `m` and `v` are the means of gradients g and of their squares, `w` the weight. As both means begin
# at 0, they are too small: `learning` is the rate over the factor of the first, `mend` one over
# that of the second. ROOT is the square root's name on a device.
_STEP = """
    auto step = [&](float g, float& m, float& v, float& w, float learning) {
        m = beta1 * m + (1.0f - beta1) * g;
        v = beta2 * v + (1.0f - beta2) * g * g;
        w -= learning * m / (ROOT(v * mend) + epsilon);
    };
"""

STEP_ON_CPU = _STEP.replace("ROOT", "__builtin_sqrtf")
STEP_ON_CUDA = _STEP.replace("ROOT", "sqrtf")

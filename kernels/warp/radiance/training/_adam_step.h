#pragma once

// The step of Adam for one number [Kingma and Ba 2015].
struct Adam {
    float beta1, beta2, epsilon;
    // Both means begin at 0, so they are too small. This is 1 over the factor of the second mean;
    // the learning rate is already divided by the factor of the first.
    float mend;

    // Update the means m and v of gradients g and of their squares, and the weight w.
    void step(float g, float& m, float& v, float& w, float learning) const {
#ifdef __CUDA_ARCH__
        m = beta1 * m + (1.0f - beta1) * g;
        v = beta2 * v + (1.0f - beta2) * g * g;
        w -= learning * m / (sqrtf(v * mend) + epsilon);
#else
#pragma clang fp contract(fast)
        m = beta1 * m + (1.0f - beta1) * g;
        v = beta2 * v + (1.0f - beta2) * g * g;
        w -= learning * m / (__builtin_sqrtf(v * mend) + epsilon);
#endif
    }
};

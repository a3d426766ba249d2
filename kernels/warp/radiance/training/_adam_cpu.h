#include "_adam_step.h"

// One step for weights `first` to `last`; a sparse step leaves weights with gradient 0 unchanged.
void move(int first, int last, wp::array_t<float> rate, wp::array_t<float> factor, AdamRule rule,
          Learnt learnt, wp::array_t<float> copy) {
#pragma clang fp contract(fast)
    const Adam adam = {rule.beta1, rule.beta2, rule.epsilon, 1.0f / rate.data[2]};
    const float learning = rate.data[0] / rate.data[1], scale = factor.data[0];
    const float decay = rule.decay;
    const bool sparse = rule.sparse;
    float *gs = learnt.gradients.data, *ms = learnt.mean.data, *vs = learnt.square.data;
    float *ws = learnt.weights.data, *again = copy.data;
#pragma clang loop vectorize(assume_safety)
    for (int i = first; i < last; ++i) {
        const float slope = gs[i] * scale, m0 = ms[i], v0 = vs[i], w0 = ws[i];
        float m1 = m0, v1 = v0, w1 = w0;
        adam.step(slope + decay * w0, m1, v1, w1, learning);
        const bool moves = !sparse || slope != 0.0f;
        gs[i] = 0.0f;
        ms[i] = moves ? m1 : m0;
        vs[i] = moves ? v1 : v0;
        ws[i] = moves ? w1 : w0;
        again[i] = moves ? w1 : w0;
    }
}

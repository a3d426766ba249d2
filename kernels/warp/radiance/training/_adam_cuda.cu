#include "_adam_step.h"

// needs HALF
// One step for four weights, or for one of the remaining ones.
void move(int thread, wp::array_t<float> rate, wp::array_t<float> factor, AdamRule rule,
          Learnt learnt, wp::array_t<Scalar> copy) {
    const Adam adam = {rule.beta1, rule.beta2, rule.epsilon, 1.0f / rate.data[2]};
    const float learning = rate.data[0] / rate.data[1], scale = factor.data[0];
    auto move_one = [&](float slope, float& m, float& v, float& w) {
        const float g = slope * scale;
        if (rule.sparse && g == 0.0f) return;
        adam.step(g + rule.decay * w, m, v, w, learning);
    };
    const int quads = learnt.weights.shape[0] / 4;
    if (thread < quads) {
        float4& slope = ((float4*)learnt.gradients.data)[thread];
        const float4 g = slope;
        const bool any = g.x != 0.0f || g.y != 0.0f || g.z != 0.0f || g.w != 0.0f;
        if (rule.sparse && !any) return;
        float4 m = ((float4*)learnt.mean.data)[thread];
        float4 v = ((float4*)learnt.square.data)[thread];
        float4 w = ((float4*)learnt.weights.data)[thread];
        move_one(g.x, m.x, v.x, w.x);
        move_one(g.y, m.y, v.y, w.y);
        move_one(g.z, m.z, v.z, w.z);
        move_one(g.w, m.w, v.w, w.w);
        if (any) slope = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
        ((float4*)learnt.mean.data)[thread] = m;
        ((float4*)learnt.square.data)[thread] = v;
        ((float4*)learnt.weights.data)[thread] = w;
        if (HALF) {
            uint2 halves;
            asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(halves.x) : "f"(w.y), "f"(w.x));
            asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(halves.y) : "f"(w.w), "f"(w.z));
            ((uint2*)copy.data)[thread] = halves;
        } else if ((void*)copy.data != (void*)learnt.weights.data) {
            ((float4*)copy.data)[thread] = w;
        }
    } else {
        const int i = 3 * quads + thread;
        float w = learnt.weights.data[i];
        move_one(learnt.gradients.data[i], learnt.mean.data[i], learnt.square.data[i], w);
        learnt.gradients.data[i] = 0.0f;
        learnt.weights.data[i] = w;
        if (HALF) {
            unsigned short half;
            asm("cvt.rn.f16.f32 %0, %1;" : "=h"(half) : "f"(w));
            ((unsigned short*)copy.data)[i] = half;
        } else {
            ((float*)copy.data)[i] = w;
        }
    }
}

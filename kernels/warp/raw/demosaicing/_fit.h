#pragma once
// needs FLOOR, TINY
// The line that a window of samples p has over guides q: its slope a, intercept b and weight w.
struct Fit {
    float w, wa, wb;

    // The means, the mean products of deviations, the mean products, and the weight of the prior.
    CUDA_CALLABLE Fit(float mp, float mq, float uv, float vv, float uu, float pp, float pq,
                      float qq, float prior) {
#pragma clang fp contract(off)
        const float least = (mp * mp + mq * mq) * (float)FLOOR + (float)TINY;
        const float left = uu - uv * uv / (vv + least);
        const float extra = prior * (left > 0.0f ? left : 0.0f) + least;
        const float a = (uv + extra) / (vv + extra);
        const float b = mp - a * mq;
        const float rp = pp - mp * mp, rc = pq - mp * mq, rq = qq - mq * mq;
        const float off = (rp - 2.0f * a * rc) + a * a * rq;
        w = 1.0f / ((off > 0.0f ? off : 0.0f) + least);
        wa = w * a;
        wb = w * b;
    }
};

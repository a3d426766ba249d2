#include "_compositing_walk.cu"

void composite(int ray, wp::array_t<float> sigma, wp::array_t<float> rgb,
               wp::array_t<float> distances, wp::array_t<int> spans, float stop, Composited seen) {
    const int begin = spans.data[2 * (size_t)ray], end = begin + spans.data[2 * (size_t)ray + 1];
    CompositingWalk at = {sigma.data, rgb.data, distances.data, end, stop};
    at.begin();
    float c[3] = {}, spread = 0.0f;
    for (int first = begin; first < end; first += 32) {
        at.take(first);
        c[0] += at.w * at.red;
        c[1] += at.w * at.green;
        c[2] += at.w * at.blue;
        spread += at.w * (2.0f * at.nearer + at.w * at.d / 3.0f);
        if (at.dark) break;
    }
    for (int k = 0; k < 3; ++k) c[k] = at.sum(c[k]);
    spread = at.sum(spread);
    if (at.lane() == 0) {
        for (int k = 0; k < 3; ++k) seen.color.data[3 * (size_t)ray + k] = c[k];
        seen.opacity.data[ray] = at.sum_w;
        seen.depth.data[ray] = at.sum_wt;
        seen.distortion.data[ray] = spread;
    }
}

void take_back(int ray, Composited d_seen, wp::array_t<float> sigma, wp::array_t<float> rgb,
               wp::array_t<float> distances, wp::array_t<int> spans, float stop,
               wp::array_t<float> d_sigma, wp::array_t<float> d_rgb) {
    const int begin = spans.data[2 * (size_t)ray], end = begin + spans.data[2 * (size_t)ray + 1];
    CompositingWalk at = {sigma.data, rgb.data, distances.data, end, stop};
    at.begin();
    const float* dc = d_seen.color.data + 3 * (size_t)ray;
    const float dr = dc[0], dg = dc[1], db = dc[2];
    const float d_o = d_seen.opacity.data[ray], d_t = d_seen.depth.data[ray];
    const float d_x = d_seen.distortion.data[ray];
    float rest = 0.0f;  // sum of w_j G_j, initially over all samples (w_j dX/dw_j: 2 X)
    for (int first = begin; first < end; first += 32) {
        at.take(first);
        const float g = dr * at.red + dg * at.green + db * at.blue + d_o + d_t * at.t;
        rest += at.w * (g + 2.0f * d_x * (2.0f * at.nearer + at.w * at.d / 3.0f));
        if (at.dark) break;
    }
    rest = at.sum(rest);
    const float all_w = at.sum_w, all_wt = at.sum_wt;
    at.begin();
    int first = begin;
    for (bool more = true; more && first < end; first += 32) {
        at.take(first);
        const float farther = all_wt - at.upto_wt - at.t * (all_w - at.upto_w);
        float g = dr * at.red + dg * at.green + db * at.blue + d_o + d_t * at.t;
        g += d_x * (2.0f * (at.nearer + farther) + 2.0f / 3.0f * at.w * at.d);
        const float behind = rest - at.sum_up_to(at.w * g);
        rest = __shfl_sync(0xffffffffu, behind, 31);
        if (at.own) {
            float* to = d_rgb.data + 3 * (size_t)at.row;
            d_sigma.data[at.row] = at.lit ? at.d * ((at.before - at.w) * g - behind) : 0.0f;
            to[0] = at.lit ? at.w * dr : 0.0f;
            to[1] = at.lit ? at.w * dg : 0.0f;
            to[2] = at.lit ? at.w * db : 0.0f;
        }
        more = !at.dark;
    }
    for (int i = first + at.lane(); i < end; i += 32) {
        float* to = d_rgb.data + 3 * (size_t)i;
        d_sigma.data[i] = to[0] = to[1] = to[2] = 0.0f;
    }
}

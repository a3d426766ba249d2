// needs WARPS, MOST, vec19
// The gradients by the coefficients of a warp's splats, which follow one another. Their rows of `sides`
// go through shared memory: a lane that reads its own row waits for 32 lines at a time. Returns sums
// of coefficients by harmonics, times the gradients `g` of the channels that are above 0, and these.
vec19 add_sides(int n, bool wanted, vec16 h, vec3 own, vec3 g, wp::array_t<float> sides,
                wp::array_t<float> d_sides) {
    __shared__ float rows[WARPS][32 * MOST];
    __shared__ float shares[WARPS][32][19];  // harmonics, and gradients of channels
    const int lane = threadIdx.x & 31, each = sides.shape[1] < 3 ? 0 : sides.shape[1];
    const unsigned all = __ballot_sync(0xffffffffu, wanted);
    const size_t start = (size_t)(n - lane) * each;
    float* kept = rows[threadIdx.x >> 5];
    auto* mine = shares[threadIdx.x >> 5];
    // The splat of an element, and its place among the coefficients.
    const auto walk = [=](auto visit) {
        int splat = 0, place = lane;
        for (int e = lane; e < 32 * each; e += 32, place += 32) {
            for (; place >= each; place -= each) ++splat;
            if (all >> splat & 1) visit(e, splat, place);
        }
    };
    walk([=](int e, int, int) { kept[e] = sides.data[start + e]; });
    __syncwarp();
    vec19 found;
    const float* row = kept + lane * each;
    float total[3] = {own[0], own[1], own[2]};
    for (int k = 0; k < 19; ++k) found[k] = 0.0f;
    if (wanted) {
#pragma unroll
        for (int k = 0; k < MOST / 3; ++k) {
            if (3 * k >= each) break;
            for (int c = 0; c < 3; ++c) total[c] += h[k + 1] * row[3 * k + c];
        }
        for (int c = 0; c < 3; ++c) found[16 + c] = total[c] > 0.0f ? g[c] : 0.0f;
#pragma unroll
        for (int k = 0; k < MOST / 3; ++k) {
            if (3 * k >= each) break;
            for (int c = 0; c < 3; ++c) found[k + 1] += found[16 + c] * row[3 * k + c];
        }
        for (int k = 0; k < 16; ++k) mine[lane][k] = h[k];
        for (int c = 0; c < 3; ++c) mine[lane][16 + c] = found[16 + c];
    }
    __syncwarp();
    walk([=](int e, int splat, int place) {
        d_sides.data[start + e] += mine[splat][place / 3 + 1] * mine[splat][16 + place % 3];
    });
    __syncwarp();
    return found;
}

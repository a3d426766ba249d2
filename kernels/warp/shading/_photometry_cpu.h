// Photometric stereo on the CPU; taichi/shading/photometry.py has the equations. Ranks and robust
// rules take LANES pixels at once.

// The ranks of a pixel's values among those that are finite and below the limit, LANES pixels at
// once.
// needs LEFT_OUT, MOST
void rank_rows(int slab, int first, int last, wp::array_t<float> images, wp::array_t<float> scales,
               wp::array_t<wp::uint8> mask, float limit, wp::array_t<wp::uint16> ranks) {
    enum { LANES = 16 };
    const int count = images.shape[0], width = images.shape[2];
    const size_t plane = (size_t)images.shape[1] * width;
    const size_t begin = (size_t)first * width, end = (size_t)last * width;
    const float none = __builtin_nanf("");
    const bool all = mask.shape[0] == 0;
    float value[MOST][LANES];
    for (size_t here = begin; here < end; here += LANES) {
        const int n = end - here < LANES ? (int)(end - here) : LANES;
        for (int k = 0; k < count; ++k) {
            const float* from = images.data + k * plane + here;
            for (int i = 0; i < LANES; ++i) {
                const float given = i < n ? from[i] : none;
                const bool part = __builtin_fabsf(given) < __builtin_inff() && given < limit;
                value[k][i] = part ? given * scales.data[k] : none;  // neither darker nor brighter
            }
        }
        for (int k = 0; k < count; ++k) {
            int below[LANES] = {};
            for (int j = 0; j < count; ++j)
                for (int i = 0; i < LANES; ++i)
                    below[i] +=
                        (value[j][i] < value[k][i]) | ((value[j][i] == value[k][i]) & (j < k));
            wp::uint16* to = ranks.data + k * plane + here;
            for (int i = 0; i < n; ++i) {
                const bool part = value[k][i] == value[k][i];
                to[i] = part && (all || mask.data[here + i]) ? below[i] : LEFT_OUT;
            }
        }
    }
}

// Robust rules, LANES pixels at once. Of a symmetric matrix there are xx, xy, xz, yy, yz, zz.
// needs LEFT_OUT, MOST, L1, BAYES, CONSENSUS, RIDGE, FLOOR, NOISE
void weigh_rows(int slab, int first, int last, wp::array_t<float> images,
                wp::array_t<wp::uint16> ranks, wp::array_t<float> lights, wp::array_t<float> depth,
                wp::array_t<float> windows, wp::vec2i rule, wp::array_t<float> normals,
                wp::array_t<float> albedo, wp::array_t<float> residual) {
#pragma clang fp contract(off)
    enum { LANES = 8 };
    typedef double reals __attribute__((vector_size(8 * LANES)));
    typedef long long flags __attribute__((vector_size(8 * LANES)));
    const int count = images.shape[0], width = images.shape[2];
    const int method = rule[0], sweeps = rule[1];
    const bool near = depth.shape[0] > 0;
    const size_t plane = (size_t)images.shape[1] * width;
    const size_t begin = (size_t)first * width, end = (size_t)last * width;
    const reals zero = {}, one = zero + 1.0;
    reals value[MOST], weight[MOST], variance[MOST], rank[MOST];
    const auto root = [](reals x) {
        for (int i = 0; i < LANES; ++i) x[i] = __builtin_sqrt(x[i]);
        return x;
    };
    for (size_t here = begin; here < end; here += LANES) {
        const int n = end - here < LANES ? (int)(end - here) : LANES;
        reals number = zero, above = zero, brightest = zero, px = zero, py = zero, pz = zero;
        for (int k = 0; k < count; ++k) {
            const float* from = images.data + k * plane + here;
            const wp::uint16* place = ranks.data + k * plane + here;
            for (int i = 0; i < LANES; ++i) {
                rank[k][i] = i < n ? place[i] : LEFT_OUT;
                value[k][i] = from[i < n ? i : 0];
            }
            const flags part = rank[k] != (double)LEFT_OUT;
            value[k] = part ? value[k] * (double)lights.data[5 * k + 4] : zero;
            number += part ? one : zero;
            above += value[k] > zero ? one : zero;
            brightest = value[k] > brightest ? value[k] : brightest;
        }
        flags found = (number >= 3.0) & (brightest > zero);
        bool any = false;
        for (int i = 0; i < n; ++i) {
            if (near) {
                px[i] = (double)((here + i) % width);
                py[i] = -(double)((here + i) / width);
                pz[i] = -(double)depth.data[here + i];
                if (!(__builtin_fabs(pz[i]) < __builtin_inf())) found[i] = 0;
            }
            any = any || found[i];
        }
        // A consensus leaves dark images out, but fewer than three tell no normal.
        const flags lit = method == CONSENSUS ? above >= 3.0 : zero > one;
        reals mx = zero, my = zero, mz = zero, strength = zero, total = zero, lx, ly, lz;
        const auto light = [&](int k) {
            const float* l = lights.data + 5 * k;
            lx = (double)l[0] - px;
            ly = (double)l[1] - py;
            lz = (double)l[2] - pz;
            if (near) {
                const reals r = root(lx * lx + ly * ly + lz * lz);
                const reals f = (double)l[3] / (r * r * r);
                lx *= f;
                ly *= f;
                lz *= f;
            }
        };
        for (int m = 0; m < windows.shape[0] && any; ++m) {
            reals low, high, inside = zero;
            for (int i = 0; i < LANES; ++i) {
                low[i] = __builtin_floorf(windows.data[2 * m] * (float)number[i] + 0.5f);
                high[i] = __builtin_floorf(windows.data[2 * m + 1] * (float)number[i] + 0.5f);
            }
            const auto taken = [&](int k) {
                return (rank[k] >= low) & (rank[k] < high) & (~lit | (value[k] > zero));
            };
            for (int k = 0; k < count; ++k) inside += taken(k) ? one : zero;
            low = inside < 4.0 ? zero : low;  // too few to tell their spread
            high = inside < 4.0 ? number : high;
            reals sx = zero, sy = zero, sz = zero, spread = zero, turn = zero;
            for (int sweep = 0; sweep <= sweeps; ++sweep) {
                reals xx = zero, xy = zero, xz = zero, yy = zero, yz = zero, zz = zero;
                reals bx = zero, by = zero, bz = zero;
                const reals scale = spread > zero ? spread : one;
                for (int k = 0; k < count; ++k) {
                    reals w = one;
                    light(k);
                    if (method == BAYES) {
                        if (sweep == 0) variance[k] = one;
                        w = 1.0 / (variance[k] + NOISE);
                    } else if (sweep > 0 && (method == L1 || method == CONSENSUS)) {
                        const reals e = lx * sx + ly * sy + lz * sz;
                        const reals off = (value[k] - e) / scale;
                        if (method == L1) {
                            const reals size = off < zero ? -off : off;
                            w = 1.0 / (size > 1e-3 ? size : zero + 1e-3);
                        } else {
                            const reals v = 1.0 / (1.0 + off * off);
                            w = (e > zero ? v : zero) + FLOOR;
                        }
                        w = spread > zero ? w : one;
                    }
                    w = taken(k) ? w : zero;
                    weight[k] = w;
                    const reals ax = w * lx, ay = w * ly, az = w * lz;
                    xx += ax * lx;
                    xy += ax * ly;
                    xz += ax * lz;
                    yy += ay * ly;
                    yz += ay * lz;
                    zz += az * lz;
                    bx += ax * value[k];
                    by += ay * value[k];
                    bz += az * value[k];
                }
                const reals ridge = RIDGE * (xx + yy + zz);
                const reals p = xx + ridge, q = yy + ridge, r = zz + ridge;
                const reals a = q * r - yz * yz, b = xz * yz - xy * r, c = xy * yz - xz * q;
                const reals d = p * a + xy * b + xz * c;
                const reals f = d != zero ? 1.0 / d : zero;
                const reals ixx = a * f, ixy = b * f, ixz = c * f;
                const reals iyy = (p * r - xz * xz) * f, iyz = (xy * xz - p * yz) * f;
                const reals izz = (p * q - xy * xy) * f;
                sx = ixx * bx + ixy * by + ixz * bz;
                sy = ixy * bx + iyy * by + iyz * bz;
                sz = ixz * bx + iyz * by + izz * bz;
                reals squares = zero, weights = zero;
                for (int k = 0; k < count; ++k) {
                    light(k);
                    const reals off = value[k] - (lx * sx + ly * sy + lz * sz);
                    reals w = weight[k];
                    if (method == BAYES) {
                        const reals g = variance[k], h = 1.0 / (g + NOISE);
                        const reals u = ixx * lx + ixy * ly + ixz * lz;
                        const reals v = ixy * lx + iyy * ly + iyz * lz;
                        const reals t = ixz * lx + iyz * ly + izz * lz;
                        const reals lever = lx * u + ly * v + lz * t;
                        const reals error = g * h * off / brightest;
                        const reals next = error * error + (g - g * g * h * (1.0 - h * lever));
                        for (int i = 0; i < LANES; ++i)
                            variance[k][i] = (float)(next[i] > 0.0 ? next[i] : 0.0);
                        w = w > zero ? one : zero;
                    }
                    squares += w * off * off;
                    weights += w;
                }
                const reals free = weights - 3.0;
                spread = root(squares / (free > 0.5 ? free : zero + 0.5));
                const reals power = sx * sx + sy * sy + sz * sz;
                const reals u = ixx * sx + ixy * sy + ixz * sz;
                const reals v = ixy * sx + iyy * sy + iyz * sz;
                const reals t = ixz * sx + iyz * sy + izz * sz;
                const reals along = (sx * u + sy * v + sz * t) / power;
                turn = power > zero ? (ixx + iyy + izz - along) / power : turn;
            }
            const reals length = root(sx * sx + sy * sy + sz * sz);
            const flags told = (length > zero) & (length < __builtin_inf());
            reals share = one;
            if (windows.shape[0] > 1)
                share = 1.0 / (spread * root(turn > zero ? turn : zero) + 1e-6);
            const reals part = share / length;
            mx += told ? part * sx : zero;
            my += told ? part * sy : zero;
            mz += told ? part * sz : zero;
            strength += told ? share * length : zero;
            total += told ? share : zero;
        }
        const reals length = root(mx * mx + my * my + mz * mz);
        found &= length > zero;
        mx /= found ? length : one;
        my /= found ? length : one;
        mz /= found ? length : one;
        strength /= found ? total : one;
        reals squares = zero;
        for (int k = 0; k < count && any; ++k) {
            light(k);
            const reals e = strength * (mx * lx + my * ly + mz * lz);
            const reals off = (value[k] - (e > zero ? e : zero)) / (double)lights.data[5 * k + 4];
            squares += rank[k] != (double)LEFT_OUT ? off * off : zero;
        }
        const float none = __builtin_nanf("");
        for (int i = 0; i < n; ++i) {
            float* normal = normals.data + 3 * (here + i);
            normal[0] = found[i] ? (float)mx[i] : none;
            normal[1] = found[i] ? (float)my[i] : none;
            normal[2] = found[i] ? (float)mz[i] : none;
            albedo.data[here + i] = found[i] ? (float)strength[i] : 0.0f;
            residual.data[here + i] =
                found[i] ? (float)__builtin_sqrt(squares[i] / number[i]) : 0.0f;
        }
    }
}

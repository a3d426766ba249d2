// Photometric stereo on the CPU; taichi/shading/photometry.py has the equations. Least squares
// take a part of a row at a time, which stays in the cache between the pass that solves and the one
// that compares. Ranks and robust rules take LANES pixels at once.

void solve_rows(int slab, int first, int last, wp::array_t<float> images,
                wp::array_t<float> inverse, wp::array_t<float> lights, wp::array_t<wp::uint8> mask,
                wp::array_t<float> normals, wp::array_t<float> albedo,
                wp::array_t<float> residual) {
#pragma clang fp contract(off)
    enum { PART = 512 };
    const int count = images.shape[0], width = images.shape[2];
    const size_t plane = (size_t)images.shape[1] * width;
    float a[PART], b[PART], c[PART], total[PART];
    const size_t begin = (size_t)first * width, end = (size_t)last * width;
    for (size_t here = begin; here < end; here += PART) {
        const int n = end - here < PART ? (int)(end - here) : PART;
        for (int i = 0; i < n; ++i) a[i] = b[i] = c[i] = total[i] = 0.0f;
        for (int k = 0; k < count; ++k) {
            const float* from = images.data + k * plane + here;
            const float p = inverse.data[k], q = inverse.data[count + k];
            const float r = inverse.data[2 * count + k];
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < n; ++i) {
                a[i] += p * from[i];
                b[i] += q * from[i];
                c[i] += r * from[i];
            }
        }
        for (int k = 0; k < count; ++k) {
            const float* from = images.data + k * plane + here;
            const float* light = lights.data + 4 * k;
            const float p = light[0], q = light[1], r = light[2];
#pragma clang loop vectorize(assume_safety)
            for (int i = 0; i < n; ++i) {
                const float e = p * a[i] + q * b[i] + r * c[i];
                const float off = from[i] - (e > 0.0f ? e : 0.0f);
                total[i] += off * off;
            }
        }
        for (int i = 0; i < n; ++i) {
            const float length = __builtin_sqrtf(a[i] * a[i] + b[i] * b[i] + c[i] * c[i]);
            const bool inside = mask.shape[0] == 0 || mask.data[here + i];
            const bool found = inside && length > 0.0f && length < __builtin_inff();
            const float none = __builtin_nanf("");
            float* normal = normals.data + 3 * (here + i);
            normal[0] = found ? a[i] / length : none;
            normal[1] = found ? b[i] / length : none;
            normal[2] = found ? c[i] / length : none;
            albedo.data[here + i] = found ? length : 0.0f;
            residual.data[here + i] = found ? __builtin_sqrtf(total[i] / (float)count) : 0.0f;
        }
    }
}

// The ranks of a pixel's values among those that are finite and below the limit, LANES pixels at
// once.
// needs LEFT_OUT
void rank_rows(int slab, int first, int last, wp::array_t<float> images,
               wp::array_t<wp::uint8> mask, float limit, wp::array_t<wp::uint16> ranks) {
    enum { LANES = 16 };
    const int count = images.shape[0], width = images.shape[2];
    const size_t plane = (size_t)images.shape[1] * width;
    const size_t begin = (size_t)first * width, end = (size_t)last * width;
    const float none = __builtin_nanf("");
    float value[LANES];
    int below[LANES];
    for (size_t here = begin; here < end; here += LANES) {
        const int n = end - here < LANES ? (int)(end - here) : LANES;
        bool any = false;
        const bool all = mask.shape[0] == 0;
        for (int i = 0; i < n; ++i) any = any || all || mask.data[here + i];
        if (!any) {
            for (int k = 0; k < count; ++k)
                for (int i = 0; i < n; ++i) ranks.data[k * plane + here + i] = LEFT_OUT;
            continue;
        }
        for (int k = 0; k < count; ++k) {
            const float* own = images.data + k * plane + here;
            for (int i = 0; i < LANES; ++i) {
                value[i] = i < n ? own[i] : none;
                below[i] = 0;
            }
            for (int j = 0; j < count; ++j) {
                const float* other = images.data + j * plane + here;
                if (n == LANES) {
                    // Not finite and darker is minus infinity alone; NaN compares as false.
                    for (int i = 0; i < LANES; ++i)
                        below[i] += ((other[i] < value[i]) | ((other[i] == value[i]) & (j < k))) &
                                    (other[i] > -__builtin_inff());
                } else {
                    for (int i = 0; i < n; ++i)
                        below[i] += ((other[i] < value[i]) | ((other[i] == value[i]) & (j < k))) &
                                    (other[i] > -__builtin_inff());
                }
            }
            wp::uint16* to = ranks.data + k * plane + here;
            for (int i = 0; i < n; ++i) {
                const bool in = (all || mask.data[here + i]) &&
                                __builtin_fabsf(value[i]) < __builtin_inff() && value[i] < limit;
                to[i] = in ? below[i] : LEFT_OUT;
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
    const int count = images.shape[0], width = images.shape[2];
    const int method = rule[0], sweeps = rule[1];
    const bool near = depth.shape[0] > 0;
    const size_t plane = (size_t)images.shape[1] * width;
    const size_t begin = (size_t)first * width, end = (size_t)last * width;
    double value[MOST][LANES], weight[MOST][LANES], variance[MOST][LANES];
    int rank[MOST][LANES];
    for (size_t here = begin; here < end; here += LANES) {
        const int n = end - here < LANES ? (int)(end - here) : LANES;
        int number[LANES], low[LANES], high[LANES], inside[LANES];
        bool found[LANES], any = false;
        double brightest[LANES], px[LANES], py[LANES], pz[LANES];
        for (int i = 0; i < LANES; ++i) {
            number[i] = 0;
            brightest[i] = 0.0;
            found[i] = i < n;
        }
        for (int k = 0; k < count; ++k) {
            const float* from = images.data + k * plane + here;
            const wp::uint16* place = ranks.data + k * plane + here;
            for (int i = 0; i < LANES; ++i) {
                rank[k][i] = i < n ? place[i] : LEFT_OUT;
                const bool part = rank[k][i] != LEFT_OUT;
                value[k][i] = part ? (double)from[i < n ? i : 0] : 0.0;
                number[i] += part;
                if (value[k][i] > brightest[i]) brightest[i] = value[k][i];
            }
        }
        for (int i = 0; i < LANES; ++i) {
            found[i] = found[i] && number[i] >= 3 && brightest[i] > 0.0;
            px[i] = py[i] = pz[i] = 0.0;
            if (near && i < n) {
                px[i] = (double)((here + i) % width);
                py[i] = -(double)((here + i) / width);
                pz[i] = -(double)depth.data[here + i];
                found[i] = found[i] && __builtin_fabs(pz[i]) < __builtin_inf();
            }
            any = any || found[i];
        }
        double mx[LANES], my[LANES], mz[LANES], strength[LANES], total[LANES];
        for (int i = 0; i < LANES; ++i) mx[i] = my[i] = mz[i] = strength[i] = total[i] = 0.0;
        double lx[LANES], ly[LANES], lz[LANES];
        auto light = [&](int k) {
            const float* l = lights.data + 4 * k;
            for (int i = 0; i < LANES; ++i) {
                lx[i] = l[0] - px[i];
                ly[i] = l[1] - py[i];
                lz[i] = l[2] - pz[i];
            }
            if (near)
                for (int i = 0; i < LANES; ++i) {
                    const double r = __builtin_sqrt(lx[i] * lx[i] + ly[i] * ly[i] + lz[i] * lz[i]);
                    const double f = (double)l[3] / (r * r * r);
                    lx[i] *= f;
                    ly[i] *= f;
                    lz[i] *= f;
                }
        };
        for (int m = 0; m < windows.shape[0] && any; ++m) {
            for (int i = 0; i < LANES; ++i) {
                low[i] = (int)__builtin_floorf(windows.data[2 * m] * (float)number[i] + 0.5f);
                high[i] = (int)__builtin_floorf(windows.data[2 * m + 1] * (float)number[i] + 0.5f);
                inside[i] = 0;
            }
            for (int k = 0; k < count; ++k)
                for (int i = 0; i < LANES; ++i)
                    inside[i] += (rank[k][i] >= low[i]) & (rank[k][i] < high[i]) &
                                 ((method != CONSENSUS) | (value[k][i] > 0.0));
            double sx[LANES], sy[LANES], sz[LANES], spread[LANES], turn[LANES];
            for (int i = 0; i < LANES; ++i) {
                if (inside[i] < 4) {  // too few to tell their spread
                    low[i] = 0;
                    high[i] = number[i];
                }
                sx[i] = sy[i] = sz[i] = spread[i] = turn[i] = 0.0;
            }
            for (int sweep = 0; sweep <= sweeps; ++sweep) {
                double xx[LANES], xy[LANES], xz[LANES], yy[LANES], yz[LANES], zz[LANES];
                double bx[LANES], by[LANES], bz[LANES];
                for (int i = 0; i < LANES; ++i)
                    xx[i] = xy[i] = xz[i] = yy[i] = yz[i] = zz[i] = bx[i] = by[i] = bz[i] = 0.0;
                for (int k = 0; k < count; ++k) {
                    double w[LANES];
                    light(k);
                    for (int i = 0; i < LANES; ++i) w[i] = 1.0;
                    if (method == BAYES) {
                        if (sweep == 0)
                            for (int i = 0; i < LANES; ++i) variance[k][i] = 1.0;
                        for (int i = 0; i < LANES; ++i) w[i] = 1.0 / (variance[k][i] + NOISE);
                    } else if (sweep > 0 && method == L1) {
                        for (int i = 0; i < LANES; ++i) {
                            const double e = lx[i] * sx[i] + ly[i] * sy[i] + lz[i] * sz[i];
                            double off = __builtin_fabs(value[k][i] - e);
                            off /= spread[i] > 0.0 ? spread[i] : 1.0;
                            off = off > 1e-3 ? off : 1e-3;
                            w[i] = 1.0 / (spread[i] > 0.0 ? off : 1.0);
                        }
                    } else if (sweep > 0 && method == CONSENSUS) {
                        for (int i = 0; i < LANES; ++i) {
                            const double e = lx[i] * sx[i] + ly[i] * sy[i] + lz[i] * sz[i];
                            const double off =
                                (value[k][i] - e) / (spread[i] > 0.0 ? spread[i] : 1.0);
                            const double v = 1.0 / (1.0 + off * off);
                            w[i] = (e > 0.0 ? v : 0.0) + FLOOR;
                            w[i] = spread[i] > 0.0 ? w[i] : 1.0;
                        }
                    }
                    for (int i = 0; i < LANES; ++i) {
                        const bool part = (rank[k][i] >= low[i]) & (rank[k][i] < high[i]) &
                                          ((method != CONSENSUS) | (value[k][i] > 0.0));
                        w[i] = part ? w[i] : 0.0;
                        weight[k][i] = w[i];
                        const double ax = w[i] * lx[i], ay = w[i] * ly[i], az = w[i] * lz[i];
                        xx[i] += ax * lx[i];
                        xy[i] += ax * ly[i];
                        xz[i] += ax * lz[i];
                        yy[i] += ay * ly[i];
                        yz[i] += ay * lz[i];
                        zz[i] += az * lz[i];
                        bx[i] += ax * value[k][i];
                        by[i] += ay * value[k][i];
                        bz[i] += az * value[k][i];
                    }
                }
                double ixx[LANES], ixy[LANES], ixz[LANES], iyy[LANES], iyz[LANES], izz[LANES];
                double squares[LANES], weights[LANES];
                for (int i = 0; i < LANES; ++i) {
                    const double ridge = RIDGE * (xx[i] + yy[i] + zz[i]);
                    const double p = xx[i] + ridge, q = yy[i] + ridge, r = zz[i] + ridge;
                    const double a = q * r - yz[i] * yz[i], b = xz[i] * yz[i] - xy[i] * r;
                    const double c = xy[i] * yz[i] - xz[i] * q;
                    const double d = p * a + xy[i] * b + xz[i] * c;
                    const double f = d != 0.0 ? 1.0 / d : 0.0;
                    ixx[i] = a * f;
                    ixy[i] = b * f;
                    ixz[i] = c * f;
                    iyy[i] = (p * r - xz[i] * xz[i]) * f;
                    iyz[i] = (xy[i] * xz[i] - p * yz[i]) * f;
                    izz[i] = (p * q - xy[i] * xy[i]) * f;
                    sx[i] = ixx[i] * bx[i] + ixy[i] * by[i] + ixz[i] * bz[i];
                    sy[i] = ixy[i] * bx[i] + iyy[i] * by[i] + iyz[i] * bz[i];
                    sz[i] = ixz[i] * bx[i] + iyz[i] * by[i] + izz[i] * bz[i];
                    squares[i] = weights[i] = 0.0;
                }
                for (int k = 0; k < count; ++k) {
                    light(k);
                    for (int i = 0; i < LANES; ++i) {
                        const double e = lx[i] * sx[i] + ly[i] * sy[i] + lz[i] * sz[i];
                        const double off = value[k][i] - e;
                        if (method == BAYES) {
                            const double g = variance[k][i], d = 1.0 / (g + NOISE);
                            const double u = ixx[i] * lx[i] + ixy[i] * ly[i] + ixz[i] * lz[i];
                            const double v = ixy[i] * lx[i] + iyy[i] * ly[i] + iyz[i] * lz[i];
                            const double t = ixz[i] * lx[i] + iyz[i] * ly[i] + izz[i] * lz[i];
                            const double lever = lx[i] * u + ly[i] * v + lz[i] * t;
                            const double of = g * d * off / brightest[i];
                            const double h = of * of + (g - g * g * d * (1.0 - d * lever));
                            variance[k][i] = (double)(float)(h > 0.0 ? h : 0.0);
                        }
                        const bool part = weight[k][i] > 0.0;
                        const double w = method == BAYES ? (part ? 1.0 : 0.0) : weight[k][i];
                        squares[i] += w * off * off;
                        weights[i] += w;
                    }
                }
                for (int i = 0; i < LANES; ++i) {
                    const double free = weights[i] - 3.0;
                    spread[i] = __builtin_sqrt(squares[i] / (free > 0.5 ? free : 0.5));
                    const double power = sx[i] * sx[i] + sy[i] * sy[i] + sz[i] * sz[i];
                    const double u = ixx[i] * sx[i] + ixy[i] * sy[i] + ixz[i] * sz[i];
                    const double v = ixy[i] * sx[i] + iyy[i] * sy[i] + iyz[i] * sz[i];
                    const double t = ixz[i] * sx[i] + iyz[i] * sy[i] + izz[i] * sz[i];
                    if (power > 0.0)
                        turn[i] = (ixx[i] + iyy[i] + izz[i] -
                                   (sx[i] * u + sy[i] * v + sz[i] * t) / power) /
                                  power;
                }
            }
            for (int i = 0; i < LANES; ++i) {
                const double length = __builtin_sqrt(sx[i] * sx[i] + sy[i] * sy[i] + sz[i] * sz[i]);
                if (length > 0.0 && length < __builtin_inf()) {
                    const double t = turn[i] > 0.0 ? turn[i] : 0.0;
                    const double share =
                        windows.shape[0] > 1 ? 1.0 / (spread[i] * __builtin_sqrt(t) + 1e-6) : 1.0;
                    mx[i] += share / length * sx[i];
                    my[i] += share / length * sy[i];
                    mz[i] += share / length * sz[i];
                    strength[i] += share * length;
                    total[i] += share;
                }
            }
        }
        double squares[LANES];
        for (int i = 0; i < LANES; ++i) {
            const double length = __builtin_sqrt(mx[i] * mx[i] + my[i] * my[i] + mz[i] * mz[i]);
            found[i] = found[i] && length > 0.0;
            mx[i] /= found[i] ? length : 1.0;
            my[i] /= found[i] ? length : 1.0;
            mz[i] /= found[i] ? length : 1.0;
            strength[i] /= found[i] ? total[i] : 1.0;
            squares[i] = 0.0;
        }
        for (int k = 0; k < count && any; ++k) {
            light(k);
            for (int i = 0; i < LANES; ++i) {
                const double e = strength[i] * (mx[i] * lx[i] + my[i] * ly[i] + mz[i] * lz[i]);
                const double off = value[k][i] - (e > 0.0 ? e : 0.0);
                squares[i] += rank[k][i] != LEFT_OUT ? off * off : 0.0;
            }
        }
        for (int i = 0; i < n; ++i) {
            float* normal = normals.data + 3 * (here + i);
            normal[0] = found[i] ? (float)mx[i] : __builtin_nanf("");
            normal[1] = found[i] ? (float)my[i] : __builtin_nanf("");
            normal[2] = found[i] ? (float)mz[i] : __builtin_nanf("");
            albedo.data[here + i] = found[i] ? (float)strength[i] : 0.0f;
            residual.data[here + i] =
                found[i] ? (float)__builtin_sqrt(squares[i] / (double)number[i]) : 0.0f;
        }
    }
}
